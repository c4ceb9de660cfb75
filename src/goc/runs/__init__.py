"""A run on disk: its output folder, its checkpoint, what it took and on which machine."""

from goc.runs.machine import Machine, peak_memory_mb, this_machine
from goc.runs.output import Output, check_output, claim_output, is_stopped_run
from goc.runs.record import RunRecord

__all__ = [
    "Machine",
    "Output",
    "RunRecord",
    "check_output",
    "claim_output",
    "is_stopped_run",
    "peak_memory_mb",
    "this_machine",
]
