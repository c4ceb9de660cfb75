"""Errors that a user can cause, one class a stage; the command line prints their text and nothing else."""

import re
from collections.abc import Callable


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
    """A setting is out of range or contradicts another.

    The text names settings by their fields in braces, as in `{near_m} is 3: needs less than {far_m}.` From Python they
    read `StereoConfig.near_m`; the command line, which knows where that class is nested, puts its flags there.
    """

    def __init__(self, text: str, owner: type | None = None) -> None:
        """Say what is wrong.

        Args:
            text: one line; names in braces are fields of `owner`.
            owner: class of the settings at fault; None where the text names no field.
        """
        self.text, self.owner = text, owner
        super().__init__(self.spelled(lambda name: f"{owner.__name__}.{name}") if owner else text)

    def spelled(self, spell: Callable[[str], str]) -> str:
        """The text with every name in braces replaced by what `spell` makes of it."""
        return re.sub(r"\{(\w+)\}", lambda found: spell(found[1]), self.text)


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
