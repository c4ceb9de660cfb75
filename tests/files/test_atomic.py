import errno
import os

import pytest

from goc.errors import FileError
from goc.files import write_atomic, write_bytes


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_appears_with_its_folders(tmp_path):
    write_bytes(tmp_path / "a/b/c.bin", b"new")
    assert (tmp_path / "a/b/c.bin").read_bytes() == b"new"
    assert names(tmp_path / "a/b") == ["c.bin"]


def test_nothing_is_seen_before_the_block_ends(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with write_atomic(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"
    assert path.read_bytes() == b"new"


def test_a_block_that_raises_leaves_the_old_file_and_no_crumbs(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    with pytest.raises(KeyboardInterrupt), write_atomic(path) as file:
        file.write(b"half")
        raise KeyboardInterrupt
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_full_disk_is_one_line_and_leaves_the_old_file(tmp_path, monkeypatch, step):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / "file"
    path.write_bytes(b"old")
    monkeypatch.setattr(os, step, full)
    with pytest.raises(FileError, match=r"file: cannot be written \(No space left on device\)\. Free some disk space"):
        write_bytes(path, b"new")
    monkeypatch.undo()
    assert path.read_bytes() == b"old"
    assert names(tmp_path) == ["file"]


def test_a_folder_in_the_way_is_refused(tmp_path):
    (tmp_path / "taken").mkdir()
    with pytest.raises(FileError, match="taken: cannot be written .* Remove the folder of that name"):
        write_bytes(tmp_path / "taken", b"")


def test_a_file_in_place_of_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(FileError, match="A part of this path is a file"):
        write_bytes(tmp_path / "file/inner", b"")


def test_a_name_no_file_can_have_is_refused(tmp_path):
    with pytest.raises(FileError, match="cannot be written"):
        write_bytes(tmp_path / "nul\0", b"")
