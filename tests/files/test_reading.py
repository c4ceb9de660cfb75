import tracemalloc

import pytest

from goc.errors import FileError
from goc.files import is_file, is_folder, read_bytes


def test_a_small_file_takes_little_memory_whatever_the_limit(tmp_path):
    (tmp_path / "small").write_bytes(b"x" * 100)
    tracemalloc.start()
    try:
        assert read_bytes(tmp_path / "small", limit=1 << 33) == b"x" * 100
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_a_file_beyond_the_limit_is_refused_unread(tmp_path):
    with (tmp_path / "large").open("wb") as file:
        file.truncate(1 << 40)  # sparse
    with pytest.raises(FileError, match="large: 1,099,511,627,776 bytes, but at most 1,000 are expected"):
        read_bytes(tmp_path / "large", limit=1000)


@pytest.mark.parametrize("name", ["absent", "nul\0", "x" * 5000, ""])
def test_names_that_no_file_has_are_not_files(tmp_path, name):
    assert not is_file(tmp_path / name)
    with pytest.raises(FileError):
        read_bytes(tmp_path / name, limit=10)


def test_files_and_folders_are_told_apart(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    assert is_file(tmp_path / "file")
    assert not is_folder(tmp_path / "file")
    assert is_folder(tmp_path)
    assert not is_folder(tmp_path / "nul\0")
