"""Run folder to one self-contained html; reads files only."""

from gatjax.report.page import build_report, headline, onward

__all__ = ["build_report", "headline", "onward"]
