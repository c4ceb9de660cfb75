import pytest
import torch

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_tensors, write_tensors

TENSORS = {
    "means": torch.arange(12.0).reshape(4, 3),
    "step": torch.tensor(7),
    "rng": torch.arange(16, dtype=torch.uint8),
    "turned": torch.arange(6.0).reshape(2, 3).T,
}


def test_tensors_come_back_bit_equal(tmp_path):
    write_tensors(tmp_path / "state.safetensors", TENSORS, {"version": "1"})
    tensors, metadata = read_tensors(tmp_path / "state.safetensors")
    assert metadata == {"version": "1"}
    assert tensors.keys() == TENSORS.keys()
    for name, tensor in tensors.items():
        assert torch.equal(tensor, TENSORS[name])
        assert tensor.dtype == TENSORS[name].dtype


def test_the_same_content_gives_the_same_bytes(tmp_path):
    write_tensors(tmp_path / "a", TENSORS, {"x": "1", "y": "2"})
    write_tensors(tmp_path / "b", dict(reversed(TENSORS.items())), {"y": "2", "x": "1"})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_what_was_read_survives_an_overwrite(tmp_path):
    write_tensors(tmp_path / "a", TENSORS)
    before, _ = read_tensors(tmp_path / "a")
    write_tensors(tmp_path / "a", {name: torch.zeros_like(tensor) for name, tensor in TENSORS.items()})
    assert torch.equal(before["means"], TENSORS["means"])


def test_a_missing_or_foreign_file_is_refused(tmp_path):
    with pytest.raises(FileError, match="absent: not found"):
        read_tensors(tmp_path / "absent")
    (tmp_path / "foreign").write_bytes(b"PK\x03\x04" + bytes(100))
    with pytest.raises(FileError, match="foreign: not a readable safetensors file"):
        read_tensors(tmp_path / "foreign")


def test_damaged_files_raise_only_file_errors(tmp_path):
    write_tensors(tmp_path / "good.safetensors", TENSORS, {"version": "1"})
    assert_only_file_errors(read_tensors, tmp_path / "good.safetensors")
