"""The output folder: claimed before any work, filled aside, put in place when everything is there."""

import fcntl
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from goc.errors import ExportError
from goc.files import is_file, move_file
from goc.files.layout import REPORT, run_files

_WORK = ".work"
_CHECKPOINT = "checkpoint.safetensors"


@dataclass(frozen=True, kw_only=True)
class Output:
    """A folder that this run, and no other, writes into."""

    folder: Path
    resumes: bool
    """There is a checkpoint to continue from."""

    @property
    def checkpoint(self) -> Path:
        """Where the optimisation keeps its state; gone once results are published."""
        return self.folder / _WORK / _CHECKPOINT

    @property
    def staged(self) -> Path:
        """Where results are written; they appear in `folder` when published."""
        return self.folder / _WORK / "staged"

    def publish(self) -> None:
        """Move all staged files into place, report.json last; remove what only an earlier run wrote.

        A folder without report.json is one where this was interrupted.
        """
        new = sorted(path.relative_to(self.staged) for path in self.staged.rglob("*") if path.is_file())
        try:
            (self.folder / REPORT).unlink(missing_ok=True)
            for old in run_files(self.folder):
                if old not in new:
                    (self.folder / old).unlink()
                    with suppress(OSError):  # somebody else's files are in it
                        (self.folder / old).parent.rmdir()
            for name in sorted(new, key=lambda name: name == Path(REPORT)):
                move_file(self.staged / name, self.folder / name)
            self.checkpoint.unlink(missing_ok=True)
        except OSError as error:
            raise ExportError(
                f"{error.filename}: cannot be replaced ({error.strerror}). Check its permissions."
            ) from error


@contextmanager
def claim_output(folder: Path, overwrite: bool, resume: bool) -> Iterator[Output]:
    """Make sure that results may be written, before any work is done, and keep other runs out meanwhile.

    Args:
        folder: made if need be.
        overwrite: what goc wrote there may be replaced, and a stopped run forgotten.
        resume: a stopped run there is continued.

    Raises:
        ExportError: results or foreign files are in the way, another run is writing, or the system refuses.
    """
    check_output(folder, overwrite, resume)
    work, made = folder / _WORK, not folder.exists()
    output = Output(folder=folder, resumes=resume and is_stopped_run(folder))
    try:
        work.mkdir(parents=True, exist_ok=True)
        lock = (work / "lock").open("w")
    except OSError as error:
        raise ExportError(f"{folder}: cannot be used ({error.strerror}). Choose a folder you may write to.") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # let go by the system, however this process ends
        except OSError as error:
            raise ExportError(f"{folder}: another run of goc writes here. Wait for it, or choose another.") from error
        try:
            shutil.rmtree(output.staged, ignore_errors=True)
            if not output.resumes:
                output.checkpoint.unlink(missing_ok=True)
            yield output
        finally:
            _tidy(output, made)


def check_output(folder: Path, overwrite: bool, resume: bool) -> None:
    """Refuse a folder whose content is in the way; nothing is touched.

    Raises:
        ExportError: see `claim_output`.
    """
    try:
        entries = sorted(path.name for path in folder.iterdir() if path.name != _WORK)
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ExportError(f"{folder}: cannot be used as output folder ({reason}). Choose another one.") from error
    if is_stopped_run(folder) and not (resume or overwrite):
        raise ExportError(
            f"{folder}: holds a stopped run. Repeat its command with --resume to continue it, "
            "or with --overwrite to start again."
        )
    if entries and not overwrite:
        several = f"{len(entries)} entries, first: {entries[0]}"
        remedy = "Choose another folder, or pass --overwrite to replace what goc wrote there."
        raise ExportError(f"{folder}: is not empty ({several}). {remedy}")


def is_stopped_run(folder: Path) -> bool:
    """Whether a run that was stopped left a checkpoint in its output folder."""
    return is_file(folder / _WORK / _CHECKPOINT)


def _tidy(output: Output, made: bool) -> None:
    """Leave nothing behind but results or a checkpoint."""
    shutil.rmtree(output.staged, ignore_errors=True)
    if not is_file(output.checkpoint):
        shutil.rmtree(output.folder / _WORK, ignore_errors=True)
        if made:
            with suppress(OSError):  # results are in it
                output.folder.rmdir()
