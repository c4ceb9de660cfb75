"""ScanNet scenes, exported."""

import io
import json
import zipfile

import numpy as np
import pytest
from PIL import Image

from goc.capture import CaptureConfig, load_capture
from goc.errors import CaptureError
from goc.files import read_ids, write_png
from goc.synth.export import export_room
from roundtrips import assert_same_cameras, assert_same_frames


@pytest.fixture
def folder(room, tmp_path):
    return export_room(room, "scannet", tmp_path / "scene0000_00")


def test_a_scene_is_what_was_exported(truth, folder):
    capture = load_capture(folder)
    assert_same_cameras(capture, truth)
    assert_same_frames(capture, truth)
    assert (capture.metric, capture.units_per_metre) == (True, 1.0)
    assert capture.view_names[10] == "color/10.jpg"  # numbers, not letters, are sorted
    assert capture.id_names == {1: "crate", 2: "cupboard"}


def test_views_that_were_lost_are_left_out_and_counted(truth, folder):
    for number in (2, 10):
        (folder / f"pose/{number}.txt").write_text("-inf -inf -inf -inf\n" * 4)
    heard = []
    capture = load_capture(folder, notify=heard.append)
    assert len(capture) == 10
    assert "color/2.jpg" not in capture.view_names
    assert [event.message for event in heard] == [
        "2 of 12 poses were lost (not finite), and their views are left out (first: color/2.jpg)"
    ]


def test_pixels_that_nobody_annotated_are_unlabelled_not_room(truth, folder):
    ids = read_ids(folder / "instance-filt/0.png").astype(np.uint8)
    ids[:4] = 0
    write_png(folder / "instance-filt/0.png", ids)
    found = load_capture(folder)[0].ids
    assert (found[:4] == -1).all()
    np.testing.assert_array_equal(found[4:], truth[0].ids[4:])


def test_annotations_are_read_where_they_lie_in_their_archives(truth, folder):
    for method in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        with zipfile.ZipFile(folder / "scene0000_00_2d-instance-filt.zip", "w", method) as packed:
            for number, frame in enumerate(truth):
                stored = np.where(frame.ids.numpy() == 0, 3, frame.ids.numpy())
                encoded = io.BytesIO()
                Image.fromarray(stored.astype(np.uint8)).save(encoded, "PNG")
                packed.writestr(f"instance-filt/{number}.png", encoded.getvalue())
        for file in (folder / "instance-filt").glob("*.png"):
            file.unlink()
        assert_same_frames(load_capture(folder), truth)


def test_without_an_aggregation_the_label_images_tell_the_room(truth, folder):
    next(folder.glob("*.aggregation.json")).unlink()
    for number, frame in enumerate(truth):
        write_png(folder / f"label-filt/{number}.png", np.array([1, 2, 7], np.uint16)[frame.ids.numpy()])
    assert_same_frames(load_capture(folder), truth)
    rows = [
        "id\traw_category\tcategory\tcount\tnyu40id",
        "1\twall\twall\t9\t1",
        "2\tchair\tchair\t9\t5",
        "7\tcabinet\t\t\t3",
    ]
    (folder.parent / "scannetv2-labels.combined.tsv").write_text("\n".join(rows))
    capture = load_capture(folder)
    assert_same_frames(capture, truth)
    assert capture.id_names == {1: "chair", 2: "cabinet"}


def test_instances_without_labels_are_all_objects_and_that_is_said(folder):
    next(folder.glob("*.aggregation.json")).unlink()
    heard = []
    assert load_capture(folder, notify=heard.append)[0].ids.unique().tolist() == [1, 2, 3]
    assert "no labels tell walls and floor from things" in heard[0].message


def test_long_recordings_are_thinned_and_that_is_said(folder):
    assert load_capture(folder, CaptureConfig(every=5)).view_names == ("color/0.jpg", "color/5.jpg", "color/10.jpg")


@pytest.mark.parametrize(
    ("gone", "message"),
    [
        ("pose", r"a ScanNet capture without pose/\."),
        ("intrinsic/intrinsic_color.txt", "without intrinsic/intrinsic_color.txt"),
        ("pose/3.txt", r"1 of 12 images have no pose \(first: 3\.jpg\)"),
        ("depth/3.png", r"1 of 12 depth images are missing \(first: color/3\.jpg\)"),
    ],
)
def test_what_is_missing_is_said(folder, gone, message):
    (folder / gone).rename(folder.parent / "gone")
    with pytest.raises(CaptureError, match=message):
        load_capture(folder)


def test_an_aggregation_says_which_instances_are_the_room(folder):
    file = next(folder.glob("*.aggregation.json"))
    document = json.loads(file.read_text())
    document["segGroups"][0]["label"] = "doorframe"
    file.write_text(json.dumps(document))
    assert set(load_capture(folder)[0].ids.unique().tolist()) <= {0, 2}
