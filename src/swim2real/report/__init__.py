"""The report: a run folder in, one self-contained HTML page out; and the page of the track checks."""

from swim2real.report.errors import standing, warnings
from swim2real.report.page import write_report
from swim2real.report.quality_page import write_quality_page
from swim2real.report.run import read_run
from swim2real.report.runs_page import write_runs_page

__all__ = ["read_run", "standing", "warnings", "write_quality_page", "write_report", "write_runs_page"]
