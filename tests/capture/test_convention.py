import numpy as np
import pytest

from captures import poses, write_nerfstudio, write_rgbd
from damage import FLIP
from damage import poses as changed_poses
from goc.capture import CaptureConfig, load_capture
from goc.capture.convention import OPENCV_AXES, Convention, inverse, reread
from goc.capture.source import Source
from goc.errors import CaptureError


@pytest.mark.parametrize("axes", list(OPENCV_AXES))
@pytest.mark.parametrize("direction", ["camera-to-world", "world-to-camera"])
def test_reading_as_stated_and_back_changes_nothing(axes, direction, tmp_path):
    stack = np.stack(poses(4))
    format = Source(path=tmp_path, views=(), axes="opengl")
    stated = reread(stack, format, Convention(axes=axes, poses=direction))
    back = reread(
        stated,
        Source(path=tmp_path, views=(), axes=axes, direction=direction),
        Convention(axes="opengl", poses="camera-to-world"),
    )
    np.testing.assert_allclose(back, stack, atol=1e-12)
    np.testing.assert_allclose(inverse(stated) @ stated, np.tile(np.eye(4), (4, 1, 1)), atol=1e-12)


@pytest.mark.parametrize(
    ("spoil", "options"),
    [
        (changed_poses(np.linalg.inv), {"poses": "world-to-camera"}),
        (changed_poses(lambda p: p @ FLIP), {"axes": "opencv"}),
        (changed_poses(lambda p: np.linalg.inv(p @ FLIP)), {"poses": "world-to-camera", "axes": "opencv"}),
    ],
)
def test_what_is_said_to_be_the_remedy_is_one(tmp_path, spoil, options):
    write_nerfstudio(tmp_path, views=12)
    spoil(tmp_path)
    with pytest.raises(CaptureError, match="--capture.convention"):
        load_capture(tmp_path)
    capture = load_capture(tmp_path, CaptureConfig(convention=Convention(**options)))
    for camera, pose in zip(capture.cameras, poses(12), strict=True):
        np.testing.assert_allclose(camera.world_from_cam, pose, atol=1e-5)


def test_units_are_stated_for_any_format(tmp_path):
    write_rgbd(tmp_path, views=8, change=lambda meta: meta.update(depth_scale=1.0))
    with pytest.raises(
        CaptureError, match=r"depth looks like millimetres: .* --capture\.convention\.depth-unit 0\.001"
    ):
        load_capture(tmp_path)
    frame = load_capture(tmp_path, CaptureConfig(convention=Convention(depth_unit=0.001)))[0]
    assert 0.3 < frame.depth.median() < 4


def test_room_ids_become_the_room(tmp_path):
    write_nerfstudio(tmp_path, views=4)
    ids = load_capture(tmp_path, CaptureConfig(checks="off", convention=Convention(room_ids=(2,))))[0].ids
    assert set(ids.unique().tolist()) <= {-1, 0, 1}
    assert (ids == 0).sum() > 0


def test_contradictions_may_be_warnings_or_unchecked(tmp_path):
    write_nerfstudio(tmp_path, views=8)
    changed_poses(np.linalg.inv)(tmp_path)
    heard = []
    load_capture(tmp_path, CaptureConfig(checks="warn"), heard.append)
    assert any("poses look world-to-camera" in event.message for event in heard)
    heard = []
    load_capture(tmp_path, CaptureConfig(checks="off"), heard.append)
    assert heard == []
