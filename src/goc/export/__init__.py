"""Stage 5, SceneAssets → files: meshes, splats, report.json and overview.png, put in place all at once."""

from goc.export.config import ExportConfig
from goc.export.machine import Machine, peak_memory_mb, this_machine
from goc.export.output import REPORT, Output, check_output, claim_output, is_stopped_run
from goc.export.overview import draw_overview
from goc.export.record import RunRecord
from goc.export.report import Report, write_report
from goc.export.scene import export_scene

__all__ = [
    "REPORT",
    "ExportConfig",
    "Machine",
    "Output",
    "Report",
    "RunRecord",
    "check_output",
    "claim_output",
    "draw_overview",
    "export_scene",
    "is_stopped_run",
    "peak_memory_mb",
    "this_machine",
    "write_report",
]
