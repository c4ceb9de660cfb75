"""Errors as a user meets them: one line on stderr and an exit code, a traceback only where one asks for it."""

import errno
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from goc import __version__
from goc.errors import GocError

STOPPED = 130
_RESOURCES = 4
_INTERNAL = 5
_FULL = (errno.ENOSPC, errno.EDQUOT)


def guarded(command: Callable[[], int], debug: bool) -> int:
    """Run a command; whatever goes wrong becomes one line on stderr and the exit code that belongs to it.

    Args:
        command: returns its exit code.
        debug: show the traceback as well.
    """
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # `kill` stops as Ctrl-C does
    try:
        return command()
    except KeyboardInterrupt:
        say("stopped.")
        return STOPPED
    except BrokenPipeError:  # the reader of our output went away; Python must not try to flush it again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        line, code = explain(error)
        if debug:
            traceback.print_exc()
        elif code == _INTERNAL and not isinstance(error, GocError):
            line += _kept_traceback()
        say(f"error: {line}")
        return code


def explain(error: Exception) -> tuple[str, int]:
    """What to tell a user, and the exit code."""
    cause = error.__cause__ if isinstance(error, GocError) else error
    if isinstance(cause, OSError) and cause.errno in _FULL:
        return (str(error) if isinstance(error, GocError) else _disk_full(cause)), _RESOURCES
    if isinstance(error, GocError):
        return str(error), error.exit_code
    if _is_out_of_memory(error):
        return (
            "not enough memory. Close other programs, or ask for less: --reconstruct.mcmc.max-splats, "
            "--capture.max-side-px, --capture.cache-mb, --extract.memory-blocks.",
            _RESOURCES,
        )
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror}. Check the path and its permissions.", 3
    return f"goc {__version__} failed unexpectedly ({type(error).__name__}: {_first_line(error)}).", _INTERNAL


def say(line: str) -> None:
    """Write a line to stderr."""
    with suppress(OSError):
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


def _is_out_of_memory(error: Exception) -> bool:
    """Python and numpy raise MemoryError, torch's CPU allocator a RuntimeError."""
    if isinstance(error, MemoryError):
        return True
    text = str(error).lower()
    return isinstance(error, RuntimeError) and ("not enough memory" in text or "out of memory" in text)


def _disk_full(error: OSError) -> str:
    where = f"{error.filename}: " if error.filename else ""
    return f"{where}the disk is full. Free some space, or write elsewhere."


def _first_line(error: Exception) -> str:
    lines = str(error).splitlines()
    return lines[0][:200] if lines else "no message"


def _kept_traceback() -> str:
    """Keep the traceback in a file, and say where it is."""
    try:
        descriptor, name = tempfile.mkstemp(prefix="goc-traceback-", suffix=".txt")
        with os.fdopen(descriptor, "w") as file:
            file.write(f"goc {__version__}: {' '.join(sys.argv)}\n\n{traceback.format_exc()}")
    except OSError:
        return " This is a bug: run it again with --debug and report what it prints."
    return f" This is a bug: please report it with {Path(name)}."
