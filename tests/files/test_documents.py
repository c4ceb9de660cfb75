from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import pytest

from fuzz import assert_only_file_errors
from goc.errors import FileError
from goc.files import read_json, read_matrix, write_json


class Item(msgspec.Struct):
    w: float
    name: str = ""


class Document(msgspec.Struct):
    frames: list[Item]


@dataclass(frozen=True)
class Settings:
    out: Path
    rate: float
    names: tuple[str, ...]


def written(tmp_path, text):
    path = tmp_path / "file.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "settings.json"
    write_json(
        path, {"settings": Settings(Path("a/b"), 0.5, ("x", "y")), "mean": np.float32(0.25), "bad": float("nan")}
    )
    assert read_json(path, dict) == {
        "settings": {"out": "a/b", "rate": 0.5, "names": ["x", "y"]},
        "mean": 0.25,
        "bad": None,
    }


def test_a_byte_order_mark_is_no_error(tmp_path):
    assert read_json(written(tmp_path, b"\xef\xbb\xbf" + b'{"frames":[{"w":3}]}'), Document).frames[0].w == 3.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"frames":[{"w":"3"}]}', r"file\.json: Expected `float`, got `str` - at `\$\.frames\[0\]\.w`"),
        ('{"frames":[{}]}', r"missing required field `w` - at `\$\.frames\[0\]`"),
        ('{"frames":[{"w":NaN}]}', "not valid JSON"),
        ('{"frames":[', "not valid JSON"),
        ("", "not valid JSON"),
        (b'{"frames":[{"w":1,"name":"\xff"}]}', "not valid JSON"),
        ('{"more":' + "[" * 100_000, "nested too deeply"),
    ],
)
def test_a_document_that_breaks_its_schema_is_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        read_json(written(tmp_path, text), Document)


def test_a_missing_file_or_a_folder_is_refused(tmp_path):
    with pytest.raises(FileError, match=r"absent\.json: not found"):
        read_json(tmp_path / "absent.json", Document)
    with pytest.raises(FileError, match="is a folder"):
        read_json(tmp_path, Document)


def test_damaged_documents_raise_only_file_errors(tmp_path):
    path = tmp_path / "good.json"
    write_json(path, {"frames": [{"w": float(i), "name": f"image {i}"} for i in range(30)]})
    assert_only_file_errors(lambda file: read_json(file, Document), path)


def test_a_matrix_is_read_with_blanks_or_commas(tmp_path):
    path = written(tmp_path, "1, 2 3\n\n4 5e0 -6\n")
    np.testing.assert_array_equal(read_matrix(path), [[1, 2, 3], [4, 5, -6]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n3", "rows of 1 and 2 numbers"),
        ("", "found nothing"),
        ("1 two", "expected only numbers"),
        ("1 nan\n2 inf", "2 numbers are not finite"),
        (b"\xff\xfe", "expected only numbers"),
    ],
)
def test_a_matrix_that_is_none_is_refused(tmp_path, text, message):
    with pytest.raises(FileError, match=message):
        read_matrix(written(tmp_path, text))


def test_damaged_matrices_raise_only_file_errors(tmp_path):
    path = tmp_path / "pose.txt"
    path.write_text("0.93889553 0.23483152 -0.25165323 -0.29845407\n" * 4)
    assert_only_file_errors(read_matrix, path)
