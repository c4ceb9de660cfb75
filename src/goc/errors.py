"""Errors that a user can cause, one class a stage; the command line prints their text and nothing else."""


class GocError(Exception):
    """Where, how many, the first culprit, what to do: one sentence or two, no traceback needed."""

    exit_code = 2


class FileError(GocError):
    """A file cannot be read, is malformed, or cannot be written."""

    exit_code = 3


class CaptureError(GocError):
    """A capture's files contradict each other or lack what is needed."""

    exit_code = 3


class ConfigError(GocError):
    """A setting is out of range or contradicts another."""


class EngineError(GocError):
    """Splats cannot be drawn on this machine in the way that was asked for."""

    exit_code = 4


class ReconstructError(GocError):
    """Optimisation cannot start or went wrong (non-finite loss, unusable checkpoint)."""

    exit_code = 5


class SegmentError(GocError):
    """Objects cannot be told apart in this capture."""

    exit_code = 3


class ExtractError(GocError):
    """No surface can be extracted."""

    exit_code = 5


class CompleteError(GocError):
    """An object cannot be completed, or a model cannot be loaded."""

    exit_code = 5


class TrainError(GocError):
    """Training data, a checkpoint or a loss is unusable."""

    exit_code = 5


class ExportError(GocError):
    """The output folder cannot be used."""


class BenchError(GocError):
    """A run of the benchmark failed."""

    exit_code = 5


class EvaluationError(GocError):
    """A run and a ground truth cannot be compared."""

    exit_code = 3
