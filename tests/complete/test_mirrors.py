import numpy as np
import pytest

from goc.complete.mirrors import MirrorPlane, mirror_planes, mirrored_evidence, surface_points
from goc.scene import Evidence, EvidenceGrid

CELLS = 64
BAND = 0.06


def centres() -> np.ndarray:
    axis = (np.arange(CELLS) + 0.5) * (2.0 / CELLS) - 1.0
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1)


def box_distance(points: np.ndarray, half: tuple[float, float, float], at: tuple[float, float, float]) -> np.ndarray:
    beyond = np.abs(points - np.array(at)) - np.array(half)
    return np.linalg.norm(np.maximum(beyond, 0), axis=-1) + np.minimum(beyond.max(-1), 0)


def armchair(points: np.ndarray) -> np.ndarray:
    """Mirrors itself in x = 0.1, and in nothing else: seat, back, and two arms."""
    parts = [((0.5, 0.4, 0.2), (0.1, 0, -0.3)), ((0.5, 0.1, 0.5), (0.1, 0.35, 0.0))]
    parts += [((0.1, 0.4, 0.35), (0.1 + side * 0.45, 0, -0.15)) for side in (-1, 1)]
    return np.min([box_distance(points, *part) for part in parts], axis=0)


def seen(distance: np.ndarray, known: np.ndarray) -> EvidenceGrid:
    state = np.where(
        np.abs(distance) < BAND, Evidence.SURFACE, np.where(distance > 0, Evidence.EMPTY, Evidence.UNKNOWN)
    )
    state = np.where(known, state, Evidence.UNKNOWN).astype(np.uint8)
    sdf = np.where(state == Evidence.SURFACE, distance, 0).astype(np.float32)
    return EvidenceGrid(origin=np.full(3, 1.0 / CELLS - 1.0), voxel=2.0 / CELLS, state=state, sdf=sdf)


def test_surface_points_lie_on_the_surface_and_normals_point_out() -> None:
    ball = np.linalg.norm(centres(), axis=-1) - 0.6
    points, normals = surface_points(seen(ball, np.ones(ball.shape, bool)))
    assert np.abs(np.linalg.norm(points, axis=1) - 0.6).max() < 0.01
    assert (normals * points).sum(1).min() > 0.95 * 0.6


@pytest.mark.parametrize("upright", [True, False], ids=["up known", "up unknown"])
def test_plane_of_an_armchair_is_found_with_one_arm_seen_from_inside_only(upright: bool) -> None:
    where = centres()
    evidence = seen(armchair(where), where[..., 0] < 0.5)
    planes = mirror_planes(*surface_points(evidence), evidence, up=np.array([0, 0, 1.0]) if upright else None)
    best = planes[0]
    assert abs(best.normal[0]) > np.cos(np.deg2rad(3))
    assert best.offset * np.sign(best.normal[0]) == pytest.approx(0.1, abs=0.03)
    assert best.contradiction < 0.05


def test_mirrored_evidence_is_the_whole_armchair() -> None:
    where = centres()
    distance, known = armchair(where), where[..., 0] < 0.5
    evidence = seen(distance, known)
    plane = MirrorPlane(normal=np.array([1.0, 0, 0]), offset=0.1, support=1.0, contradiction=0.0)
    found, whole = mirrored_evidence(evidence, plane), seen(distance, np.ones(known.shape, bool))
    new = ~known & (where[..., 0] < 0.9)
    assert (found.state == whole.state)[new].mean() > 0.97  # borders lie half a voxel off
    both = new & (found.state == Evidence.SURFACE) & (whole.state == Evidence.SURFACE)
    assert np.abs(found.sdf - whole.sdf)[both].max() < 1.5 * evidence.voxel
    told = known & (evidence.state != Evidence.UNKNOWN)
    np.testing.assert_array_equal(found.state[told], evidence.state[told])


def test_asymmetrical_shape_has_no_plane() -> None:
    where = centres()
    parts = [
        ((0.2, 0.5, 0.15), (-0.4, 0.1, -0.4)),
        ((0.4, 0.15, 0.2), (0.1, 0.45, 0.1)),
        ((0.1, 0.1, 0.4), (0.5, -0.3, 0)),
    ]
    distance = np.min([box_distance(where, *part) for part in parts], axis=0)
    evidence = seen(distance, np.ones(distance.shape, bool))
    assert mirror_planes(*surface_points(evidence), evidence) == ()


def test_plane_that_seen_empty_space_contradicts_is_refused() -> None:
    where = centres()
    one_armed = np.maximum(armchair(where), -box_distance(where, (0.12, 0.42, 0.3), (0.57, -0.1, 0.12)))
    cut = np.maximum(one_armed, where[..., 0] - 0.25)  # neither the arm nor half the seat is there, as rays saw
    evidence = seen(cut, np.ones(cut.shape, bool))
    planes = mirror_planes(*surface_points(evidence), evidence)
    assert not any(abs(plane.normal[0]) > 0.99 and abs(abs(plane.offset) - 0.1) < 0.05 for plane in planes)
    forgotten = seen(cut, where[..., 0] < 0.2)  # the same surface, but nobody looked at the other side
    planes = mirror_planes(*surface_points(forgotten), forgotten)
    assert any(abs(plane.normal[0]) > 0.99 and abs(abs(plane.offset) - 0.1) < 0.05 for plane in planes)


def test_plane_without_overlap_is_no_evidence() -> None:
    where = centres()
    slab = box_distance(where, (0.5, 0.3, 0.4), (0, 0, 0))
    evidence = seen(slab, (where[..., 1] < -0.1) & (np.abs(where[..., 0]) < 0.45))  # one face, its ends unseen
    planes = mirror_planes(*surface_points(evidence), evidence)
    assert not any(abs(plane.normal[1]) > 0.5 for plane in planes)


def test_few_points_have_no_plane() -> None:
    evidence = seen(centres()[..., 0], np.ones((CELLS,) * 3, bool))
    assert mirror_planes(np.zeros((10, 3)), np.zeros((10, 3)), evidence) == ()


def test_scores_are_shares_that_fall_with_contradiction() -> None:
    plain = MirrorPlane(normal=np.array([1.0, 0, 0]), offset=0.0, support=0.8, contradiction=0.0)
    doubted = MirrorPlane(normal=plain.normal, offset=0.0, support=0.8, contradiction=0.05)
    assert 0 < doubted.score < plain.score == 1.0
