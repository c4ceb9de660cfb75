from dataclasses import replace

import numpy as np
import pytest
import torch

from boxrooms import Pose, box_room, cube, orbit, table
from goc.errors import SegmentError
from goc.events import Progress, Warned
from goc.priors.segmentation import SegmentConfig, segment
from goc.priors.segmentation.surface_voxels import back_project
from goc.scene import ROOM, UNLABELLED, Capture, StoredFrames

CONFIG = SegmentConfig()
FURNISHED = {
    1: table(-0.5, 0.7),
    2: cube(1.1, 1.0, 0.0, 0.5),
    3: cube(-0.75, 0.7, 0.72, 0.25),
    4: cube(-0.15, 0.75, 0.72, 0.16),
    5: cube(0.6, 0.1, 0.0, 0.3),
}
TILT = np.linalg.qr(np.array([[0.3, -0.8, 0.5], [0.9, 0.4, 0.1], [-0.2, 0.5, 0.8]]))[0]
TILT = TILT * np.sign(np.linalg.det(TILT))


def matches(truth: Capture, found: Capture) -> dict[int, tuple[int, float]]:
    """Of each true id: the found id with the best overlap, and that intersection over union of pixels."""
    a = np.concatenate([truth[i].ids.numpy().ravel() for i in range(len(truth))]).astype(int)
    b = np.concatenate([found[i].ids.numpy().ravel() for i in range(len(found))]).astype(int)
    best = {}
    for number in np.unique(a[a >= 0]):
        scores = {}
        for other in np.unique(b[(a == number) & (b >= 0)]):
            scores[int(other)] = (a[b == other] == number).sum() / ((a == number) | (b == other)).sum()
        best[int(number)] = max(scores.items(), key=lambda item: item[1])
    return best


def assert_told_apart(truth: Capture, found: Capture, least: float) -> None:
    best = matches(truth, found)
    assert best[ROOM][0] == ROOM
    assert sorted(found.id_names) == list(range(len(best))), best
    assert len({other for other, _ in best.values()}) == len(best), best
    assert min(score for _, score in best.values()) > least, best


@pytest.fixture(scope="module")
def furnished() -> Capture:
    return box_room(FURNISHED)


def test_things_on_the_floor_and_on_a_table_are_told_apart(furnished):
    heard = []
    found = segment(furnished, CONFIG, heard.append)
    assert_told_apart(furnished, found, 0.85)
    assert all(isinstance(event, Progress) for event in heard)
    assert heard[-1].done == heard[-1].total == len(furnished)


def test_only_the_table_is_named(furnished):
    found = segment(furnished, CONFIG)
    the_table = matches(furnished, found)[1][0]
    assert found.id_names[ROOM] == "room"
    assert found.id_names[the_table] == "table"
    assert all(name == f"object {number}" for number, name in found.id_names.items() if number not in (ROOM, the_table))


def test_ids_follow_size(furnished):
    best = matches(furnished, segment(furnished, CONFIG))
    assert [best[number][0] for number in (1, 2, 5, 3, 4)] == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("moved", [Pose(TILT), Pose(TILT.T, 0.07), Pose(np.eye(3), 12.0)])
def test_up_and_scale_do_not_matter(moved):
    truth = box_room(FURNISHED, moved=moved)
    assert_told_apart(truth, segment(truth, CONFIG), 0.85)


def test_noise_of_a_centimetre_is_borne():
    truth = box_room(FURNISHED, poses=orbit(20), noise=0.01)
    assert_told_apart(truth, segment(truth, CONFIG), 0.75)


def test_order_of_views_does_not_matter(furnished):
    order = torch.randperm(len(furnished), generator=torch.Generator().manual_seed(3)).tolist()
    shuffled = replace(
        furnished,
        cameras=tuple(furnished.cameras[i] for i in order),
        view_names=tuple(furnished.view_names[i] for i in order),
        frames=lambda index: furnished.frames(order[index]),
    )
    straight, turned = segment(furnished, CONFIG), segment(shuffled, CONFIG)
    for place, index in enumerate(order):
        assert torch.equal(turned[place].ids, straight[index].ids)


def test_a_point_has_one_id_in_all_views(furnished):
    found = segment(furnished, CONFIG)
    camera, frame = furnished.cameras[0], found[0]
    sideways = replace(camera, world_from_cam=furnished.cameras[-1].world_from_cam)
    points = torch.tensor(back_project(frame.depth.double().numpy(), camera)).reshape(-1, 3)
    in_cam = (points - sideways.position) @ sideways.world_from_cam[:3, :3].double()
    pixel = (in_cam[:, :2] / in_cam[:, 2:] * sideways.focal_px + sideways.centre_px).floor().long()
    inside = ((pixel >= 0) & (pixel < torch.tensor([sideways.width, sideways.height]))).all(1) & (in_cam[:, 2] > 0)
    column, row = pixel[inside].T
    other = found[len(found) - 1]
    visible = (other.depth[row, column] - in_cam[inside, 2]).abs() < 0.01
    same = other.ids[row, column][visible] == frame.ids.reshape(-1)[inside][visible]
    assert visible.sum() > 1000
    assert same.double().mean() > 0.98  # what differs lies on borders: the pixel's centre is another point


def test_ids_given_before_play_no_part(furnished):
    blind = replace(
        furnished, frames=lambda index: replace(furnished.frames(index), ids=None), has_ids=False, id_names={7: "mug"}
    )
    with_ids, without = segment(furnished, CONFIG), segment(blind, CONFIG)
    assert without.has_ids
    assert 7 not in without.id_names
    assert all(torch.equal(with_ids[i].ids, without[i].ids) for i in range(len(blind)))


def test_pixels_and_views_without_depth_stay_unlabelled(furnished):
    def load(index):
        frame = furnished.frames(index)
        if index == 1:
            return replace(frame, depth=None)
        depth = frame.depth.clone()
        depth[:, :40] = torch.nan
        return replace(frame, depth=depth)

    found = segment(replace(furnished, frames=load), CONFIG)
    assert (found[1].ids == UNLABELLED).all()
    assert (found[0].ids[:, :40] == UNLABELLED).all()
    seen = found[0].depth.isfinite()
    assert seen[:, 40:].float().mean() > 0.5
    assert (found[0].ids[seen] != UNLABELLED).float().mean() > 0.98


def test_callers_cannot_spoil_the_cache(furnished):
    found = segment(furnished, CONFIG)
    before = found[0].ids.clone()
    found[0].ids.fill_(9)
    assert torch.equal(found[0].ids, before)


def test_a_chair_pushed_to_a_table_is_a_thing_of_its_own():
    chair = [
        ((0.13, 0.5, 0.4), (0.55, 0.9, 0.45)),
        ((0.5, 0.5, 0.0), (0.55, 0.9, 0.95)),
        ((0.15, 0.52, 0.0), (0.19, 0.56, 0.4)),
    ]
    truth = box_room({1: table(-0.4, 0.7), 2: chair})
    best = matches(truth, segment(truth, CONFIG))
    assert best[1][0] != best[2][0]
    assert min(score for _, score in best.values()) > 0.7


def test_a_sofa_is_one_thing():
    sofa = [
        ((-0.9, 0.9, 0.0), (0.9, 1.6, 0.4)),
        ((-0.9, 1.45, 0.0), (0.9, 1.65, 0.85)),
        ((-1.05, 0.9, 0.0), (-0.88, 1.65, 0.6)),
        ((0.88, 0.9, 0.0), (1.05, 1.65, 0.6)),
    ]
    truth = box_room({1: sofa})
    assert_told_apart(truth, segment(truth, CONFIG), 0.9)


def test_an_empty_room_is_said_to_be_empty():
    truth = box_room({})
    heard = []
    found = segment(truth, CONFIG, heard.append)
    assert [event.message for event in heard if isinstance(event, Warned)] == [
        "14 views show nothing but room: no object was found. Give masks to name objects yourself."
    ]
    assert set(np.unique(found[0].ids.numpy())) <= {ROOM, UNLABELLED}


def test_a_scene_without_planes_still_parts():
    def ball_view(pose, size):
        x = (np.arange(size) + 0.5 - size / 2) / size
        rays = np.stack(np.broadcast_arrays(x[None, :], x[:, None], np.ones((size, size))), -1) @ pose[:3, :3].T
        depth = np.full((size, size), np.inf)
        for centre, radius in (((0.0, 0.9, 0.4), 0.5), ((0.9, 0.3, 0.3), 0.2)):
            to = np.array(centre) - pose[:3, 3]
            half, square = rays @ to, (rays**2).sum(-1)
            under = half**2 - square * (to @ to - radius**2)
            with np.errstate(invalid="ignore"):
                hit = np.where(under > 0, (half - np.sqrt(under)) / square, np.inf)
            depth = np.minimum(depth, hit)
        return np.where(np.isfinite(depth), depth, np.nan)

    bare = box_room({}, size=(128, 128))
    frames = [
        replace(frame, depth=torch.tensor(ball_view(pose, 128), dtype=torch.float32))
        for frame, pose in zip(bare, orbit(), strict=True)
    ]
    cameras = tuple(replace(camera, focal_px=torch.tensor([128.0, 128.0])) for camera in bare.cameras)
    frames = [replace(frame, camera=camera) for frame, camera in zip(frames, cameras, strict=True)]
    found = segment(replace(bare, cameras=cameras, frames=StoredFrames(tuple(frames))), CONFIG)
    ids = np.unique(np.concatenate([found[i].ids.numpy().ravel() for i in range(len(found))]))
    assert ids.tolist() == [UNLABELLED, ROOM, 1]


def test_no_depth_is_refused(furnished):
    blind = replace(furnished, frames=lambda index: replace(furnished.frames(index), depth=None), has_depth=False)
    with pytest.raises(SegmentError, match=r"none of the 14 views has metric depth \(first: images/000.png\).*Give"):
        segment(blind, CONFIG)


def test_depth_that_is_all_nan_is_refused(furnished):
    empty = torch.full((120, 160), torch.nan)
    with pytest.raises(SegmentError, match="none of the 14 views has metric depth"):
        segment(replace(furnished, frames=lambda index: replace(furnished.frames(index), depth=empty)), CONFIG)


def test_depth_without_a_surface_is_refused(furnished):
    wild = torch.rand(120, 160, generator=torch.Generator().manual_seed(0)) * 5 + 0.1
    wild[::2] = torch.nan
    with pytest.raises(SegmentError, match="depth of the 14 views .* shows no continuous surface. Check its unit"):
        segment(replace(furnished, frames=lambda index: replace(furnished.frames(index), depth=wild)), CONFIG)


def test_wild_outliers_do_no_harm(furnished):
    def load(index):
        frame = furnished.frames(index)
        depth = frame.depth.clone()
        depth[:8, :8], depth[8:16, :8], depth[16:24, :8] = 1e30, -4.0, torch.inf
        return replace(frame, depth=depth)

    found = segment(replace(furnished, frames=load), CONFIG)
    best = matches(furnished, found)
    assert min(score for _, score in best.values()) > 0.85
    assert (found[0].ids[:24, :8] == UNLABELLED).all()


def test_one_view_is_enough_to_try(furnished):
    alone = replace(furnished, cameras=furnished.cameras[5:6], view_names=("a",), frames=StoredFrames((furnished[5],)))
    ids = segment(alone, CONFIG)[0].ids
    assert (ids == ROOM).any()
    assert (ids > 0).any()


@pytest.mark.parametrize("setting", [{"max_voxels": 4000}, {"max_views": 5}, {"voxel_m": 0.04}])
def test_coarser_settings_still_work(furnished, setting):
    best = matches(furnished, segment(furnished, SegmentConfig(**setting)))
    assert best[ROOM][1] > 0.8
    assert best[2][1] > 0.6
