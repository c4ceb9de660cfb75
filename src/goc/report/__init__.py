"""What a person looks at after a run: overview.png and report.json."""

from goc.report.overview import draw_overview, write_overview
from goc.report.report import Report, read_report, write_report

__all__ = ["Report", "draw_overview", "read_report", "write_overview", "write_report"]
