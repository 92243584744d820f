"""Run folder to one self-contained html; reads files only."""

from gatjax.report.page import build_report

__all__ = ["build_report"]
