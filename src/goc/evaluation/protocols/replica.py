"""The protocol `objectsdf-replica`: surface samples inside frustums and oriented boxes, as ObjectSDF++ has it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64
from scipy.spatial import ConvexHull, QhullError

from goc.evaluation.culling import cull_to_frustums
from goc.evaluation.metrics import SurfaceSamples, sample_surface, surface_scores
from goc.evaluation.protocols.phyrecon import joined
from goc.evaluation.protocols.protocol import MatchedRun, ProtocolResult, surface_figures
from goc.evaluation.rooms import has_surface
from goc.events import Listener, Progress
from goc.scene import ROOM, Camera, Mesh

_SCENE_SAMPLES, _OBJECT_SAMPLES = 200_000, 10_000
_SCENE_THRESHOLDS, _OBJECT_THRESHOLDS = (0.05,), (0.05, 0.01)
_SCENE_BOX, _OBJECT_BOX = 1.005, 1 / 0.9
"""Extents of the truth's oriented box are multiplied by this before the prediction is cut by it."""
_ROUNDS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class OrientedBox:
    """The smallest box round something."""

    box_from_world: Float64[np.ndarray, "3 3"]
    """Rows: the box's axes."""
    centre: Float64[np.ndarray, "3"]
    """World."""
    extents: Float64[np.ndarray, "3"]

    def holds(self, points: Float64[np.ndarray, "n 3"], scale: float) -> Bool[np.ndarray, "n"]:
        """Which points lie in the box scaled about its centre."""
        local = (points - self.centre) @ self.box_from_world.T
        return (np.abs(local) <= self.extents * scale / 2).all(axis=1)


def score_replica(matched: MatchedRun, cameras: tuple[Camera, ...], notify: Listener) -> ProtocolResult:
    """Score a run as ObjectSDF++ scores Replica.

    Raises:
        FileError: a true mesh is missing or malformed.
    """
    objects = {}
    for done, id in enumerate(matched.truth.objects):
        own = matched.matches.get(id)
        predicted = None if own is None else matched.prediction.objects[own].mesh
        true = cull_to_frustums(matched.truth.mesh(id), cameras)
        objects[id] = _scores(predicted, true, _OBJECT_BOX, _OBJECT_SAMPLES, _OBJECT_THRESHOLDS, matched.seed)
        notify(Progress(stage="score objects", done=done + 1, total=len(matched.truth.objects)))
    scene = None
    if matched.prediction.scene is not None:
        whole = cull_to_frustums(joined([matched.truth.mesh(id) for id in (ROOM, *matched.truth.objects)]), cameras)
        culled = cull_to_frustums(matched.prediction.scene, cameras)
        scene = _scores(culled, whole, _SCENE_BOX, _SCENE_SAMPLES, _SCENE_THRESHOLDS, matched.seed)
    return ProtocolResult(
        objects=objects,
        scene=scene,
        settings={
            "views": len(cameras),
            "scene_samples": _SCENE_SAMPLES,
            "object_samples": _OBJECT_SAMPLES,
            "scene_thresholds": list(_SCENE_THRESHOLDS),
            "thresholds": list(_OBJECT_THRESHOLDS),
            "scene_box_scale": _SCENE_BOX,
            "object_box_scale": _OBJECT_BOX,
        },
    )


def oriented_box(vertices: Float64[np.ndarray, "v 3"]) -> OrientedBox:
    """The box of least volume with a side in the plane of some face of the convex hull (O'Rourke 1985 bounds it).

    Flat or thinner input gets the box along the world's axes.
    """
    try:
        hull = ConvexHull(vertices)
    except QhullError:
        return _box(np.eye(3), vertices)
    corners = vertices[hull.vertices]
    normals = np.unique(np.round(hull.equations[:, :3], 6), axis=0)
    candidates = [_box(_turned(normal, corners), corners) for normal in normals]
    return min(candidates, key=lambda box: float(box.extents.prod()))


def _turned(normal: Float64[np.ndarray, "3"], corners: Float64[np.ndarray, "v 3"]) -> Float64[np.ndarray, "3 3"]:
    """Axes with z along a normal, turned about it until the rectangle round the corners is smallest."""
    z = normal / np.linalg.norm(normal)
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    flat = corners @ np.stack([x, np.cross(z, x)], axis=1)
    try:
        outline = flat[ConvexHull(flat).vertices]
    except QhullError:
        return np.stack([x, np.cross(z, x), z])
    edges = np.roll(outline, -1, axis=0) - outline
    angles = np.unique(np.round(np.arctan2(edges[:, 1], edges[:, 0]) % (np.pi / 2), 9))
    cosine, sine = np.cos(angles), np.sin(angles)
    along = np.outer(outline[:, 0], cosine) + np.outer(outline[:, 1], sine)
    across = np.outer(outline[:, 1], cosine) - np.outer(outline[:, 0], sine)
    best = int((np.ptp(along, axis=0) * np.ptp(across, axis=0)).argmin())
    first = cosine[best] * x + sine[best] * np.cross(z, x)
    return np.stack([first, np.cross(z, first), z])


def _box(axes: Float64[np.ndarray, "3 3"], corners: Float64[np.ndarray, "v 3"]) -> OrientedBox:
    local = corners @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    return OrientedBox(box_from_world=axes, centre=(low + high) / 2 @ axes, extents=high - low)


def _scores(
    predicted: Mesh | None, truth: Mesh, scale: float, count: int, thresholds: tuple[float, ...], seed: int
) -> dict[str, float]:
    nothing = SurfaceSamples(points=np.zeros((1, 3)), normals=np.zeros((1, 3)))
    if predicted is None or not has_surface(predicted) or not has_surface(truth):
        return surface_figures(surface_scores(None, nothing, thresholds), with_split=False)
    box = oriented_box(truth.vertices[np.unique(truth.faces)].astype(np.float64))
    true = sample_surface(truth, count, seed + 1)
    return surface_figures(surface_scores(_samples_inside(predicted, box, scale, count, seed), true, thresholds), False)


def _samples_inside(mesh: Mesh, box: OrientedBox, scale: float, count: int, seed: int) -> SurfaceSamples | None:
    """Area-uniform samples of the part of a mesh in a box: what is drawn outside is drawn again, up to eight times.

    The same as cutting the mesh first, but nothing has to be cut.
    """
    points, normals = np.zeros((0, 3)), np.zeros((0, 3))
    for turn in range(_ROUNDS):
        more = sample_surface(mesh, count, seed + 1000 * turn)
        inside = box.holds(more.points, scale)
        points, normals = np.concatenate([points, more.points[inside]]), np.concatenate([normals, more.normals[inside]])
        if len(points) >= count:
            break
    if len(points) == 0:
        return None
    chosen = np.sort(np.random.default_rng(seed).permutation(len(points))[:count])
    return SurfaceSamples(points=points[chosen], normals=normals[chosen])
