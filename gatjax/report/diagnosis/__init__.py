"""Diagnosis folder to one self-contained html; reads files only."""

from gatjax.report.diagnosis.page import write_report

__all__ = ["write_report"]
