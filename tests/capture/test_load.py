import pytest

from captures import write_nerfstudio
from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError, ConfigError, FileError


def test_an_empty_or_foreign_folder_says_what_was_looked_for_and_found(tmp_path):
    looked_for = r"no capture here\. Looked for transforms\.json \(nerfstudio\), or .*color/ and pose/"
    with pytest.raises(CaptureError, match=looked_for + ".*; found nothing"):
        load_capture(tmp_path)
    for number in range(8):
        (tmp_path / f"photo{number}.jpg").write_bytes(b"")
    with pytest.raises(
        CaptureError, match=looked_for + r".*; found photo0\.jpg, .* and 2 more\. Photographs without poses"
    ):
        load_capture(tmp_path)


@pytest.mark.parametrize(
    ("folder", "hint"),
    [("sparse", "sparse/ lacks cameras or images"), ("color", "Single views without pose/ cannot be carved")],
)
def test_folders_of_other_kinds_get_a_hint(tmp_path, folder, hint):
    (tmp_path / folder).mkdir()
    with pytest.raises(CaptureError, match=hint):
        load_capture(tmp_path)


def test_splits_of_other_names_are_pointed_at(tmp_path):
    (tmp_path / "transforms_sparse.json").write_text("{}")
    with pytest.raises(CaptureError, match=r"Give the file itself, such as transforms_sparse\.json"):
        load_capture(tmp_path)


def test_paths_that_are_nothing_are_refused(tmp_path):
    with pytest.raises(CaptureError, match=r"absent: not found\. Give the folder of a capture"):
        load_capture(tmp_path / "absent")
    (tmp_path / "film.mp4").write_bytes(b"")
    with pytest.raises(CaptureError, match=r"film\.mp4: is a file, but not a transforms \.json"):
        load_capture(tmp_path / "film.mp4")
    (tmp_path / "labels.json").write_text("{}")
    with pytest.raises(FileError, match=r"labels\.json: Object missing required field `frames`"):
        load_capture(tmp_path / "labels.json")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"max_side_px": 3}, "CaptureConfig.max_side_px is 3: needs 16 or more"),
        ({"units_per_metre": 0.0}, "CaptureConfig.units_per_metre is 0: needs more than 0"),
        ({"units_per_metre": float("nan")}, "CaptureConfig.units_per_metre is nan"),
        ({"cache_mb": -1}, "CaptureConfig.cache_mb is -1: needs 0 or more"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ConfigError, match=message):
        CaptureConfig(**settings)


def test_a_known_unit_makes_a_capture_metric(tmp_path):
    def change(document):
        for frame in document["frames"]:
            frame.pop("depth_file_path")

    write_nerfstudio(tmp_path, change=change)
    guessed = load_capture(tmp_path)
    assert not guessed.metric
    assert 0.3 < guessed.units_per_metre < 3  # the room is in metres
    known = load_capture(tmp_path, CaptureConfig(units_per_metre=1.0))
    assert known.metric
    assert known.units_per_metre == 1.0
