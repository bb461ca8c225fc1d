"""The report: a run folder in, one self-contained HTML page out."""

from swim2real.report.page import write_report

__all__ = ["write_report"]
