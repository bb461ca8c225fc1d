"""The report: a run folder in, one self-contained HTML page out; and the page of the track checks."""

from swim2real.report.errors import warnings
from swim2real.report.page import write_report
from swim2real.report.quality_page import write_quality_page
from swim2real.report.run import read_run

__all__ = ["read_run", "warnings", "write_quality_page", "write_report"]
