import errno

import pytest

from goc.cli.failures import guarded
from goc.errors import (
    CaptureError,
    ConfigError,
    ExportError,
    ExtractError,
    FileError,
    ReconstructError,
    SegmentError,
)


def raising(error):
    def command():
        raise error

    return command


def full_disk():
    try:
        raise OSError(errno.ENOSPC, "No space left on device", "out/mesh.ply")
    except OSError as error:
        raise FileError("out/mesh.ply: cannot be written (No space left on device). Free some.") from error


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("x is 3"), 2),
        (ExportError("out: is not empty"), 2),
        (FileError("a.png: damaged"), 3),
        (CaptureError("3 of 4 images are missing"), 3),
        (SegmentError("nothing here"), 3),
        (ReconstructError("loss"), 5),
        (ExtractError("no surface"), 5),
    ],
)
def test_errors_of_the_house_are_their_text_and_their_code(capsys, error, code):
    assert guarded(raising(error), debug=False) == code
    assert capsys.readouterr().err == f"error: {error}\n"


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (MemoryError(), 4, "not enough memory. Close other programs"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: not enough memory: you tried"), 4, "not enough memory"),
        (RuntimeError("CUDA out of memory. Tried to allocate"), 4, "not enough memory"),
        (OSError(errno.ENOSPC, "No space left on device", "out/x"), 4, "out/x: the disk is full. Free some space"),
        (OSError(errno.EDQUOT, "Quota"), 4, "the disk is full"),
        (PermissionError(errno.EACCES, "Permission denied", "out"), 3, "out: Permission denied. Check the path"),
    ],
)
def test_what_the_machine_refuses_is_one_line_too(capsys, error, code, words):
    assert guarded(raising(error), debug=False) == code
    shown = capsys.readouterr().err
    assert words in shown
    assert shown.startswith("error: ")
    assert shown.count("\n") == 1


def test_a_full_disk_is_recognised_through_the_files_layer(capsys):
    assert guarded(full_disk, debug=False) == 4
    assert capsys.readouterr().err.startswith("error: out/mesh.ply: cannot be written")


def test_a_bug_keeps_its_traceback_in_a_file_and_says_where(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert guarded(raising(KeyError("frames")), debug=False) == 5
    shown = capsys.readouterr().err
    (kept,) = tmp_path.iterdir()
    assert "failed unexpectedly (KeyError: 'frames'). This is a bug: please report it with" in shown
    assert str(kept) in shown
    assert "Traceback" not in shown
    assert "Traceback" in kept.read_text()


def test_a_bug_where_nothing_can_be_written_still_is_one_line(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "absent"))
    assert guarded(raising(ValueError("")), debug=False) == 5
    assert "run it again with --debug" in capsys.readouterr().err


def test_debug_shows_the_traceback(capsys):
    assert guarded(raising(CaptureError("bad")), debug=True) == 3
    shown = capsys.readouterr().err
    assert "Traceback" in shown
    assert shown.endswith("error: bad\n")


def test_stopping_is_no_error(capsys):
    assert guarded(raising(KeyboardInterrupt()), debug=False) == 130
    assert capsys.readouterr().err == "stopped.\n"


def test_a_command_that_works_says_nothing(capsys):
    assert guarded(lambda: 0, debug=False) == 0
    assert capsys.readouterr().err == ""
