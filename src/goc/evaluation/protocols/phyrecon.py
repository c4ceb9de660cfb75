"""The protocol `phyrecon-scannet`: vertices of re-fused meshes, as in PhyRecon's (and so the paper's) ScanNet tables.

Deviations, all because rooms with complete truth are not ScanNet scans: docs/guide/eval.md.
"""

import numpy as np
from jaxtyping import Float64
from scipy.spatial import cKDTree

from goc.evaluation.culling import RefusionConfig, fuse_renders
from goc.evaluation.metrics import sample_surface, surface_scores
from goc.evaluation.protocols.protocol import MatchedRun, ProtocolResult
from goc.evaluation.rooms import has_surface
from goc.events import Listener, Progress
from goc.scene import ROOM, Camera, Mesh

_POINT_VOXEL = 0.02
_THRESHOLD = 0.05
_NORMAL_SAMPLES = 200_000
_REFUSION_CONFIG = RefusionConfig()


def score_phyrecon(matched: MatchedRun, cameras: tuple[Camera, ...], notify: Listener) -> ProtocolResult:
    """Score a run as PhyRecon scores ScanNet: every mesh is fused again from its renders at the training poses.

    Objects with F = 0, missing ones among them, are skipped, as there.

    Raises:
        FileError: a true mesh is missing or malformed.
    """
    objects = {}
    for done, id in enumerate(matched.truth.objects):
        own = matched.matches.get(id)
        predicted = None if own is None else matched.prediction.objects[own].mesh
        objects[id] = _scores(predicted, matched.truth.mesh(id), cameras, matched.seed)
        notify(Progress(stage="fuse and score", done=done + 1, total=len(matched.truth.objects) + 1))
    scene = None
    if matched.prediction.scene is not None:
        whole = joined([matched.truth.mesh(id) for id in (ROOM, *matched.truth.objects)])
        scene = _scores(matched.prediction.scene, whole, cameras, matched.seed)
    notify(Progress(stage="fuse and score", done=len(objects) + 1, total=len(objects) + 1))
    return ProtocolResult(
        objects=objects,
        scene=scene,
        settings={
            "views": len(cameras),
            "fusion_voxel": _REFUSION_CONFIG.voxel,
            "fusion_truncation": _REFUSION_CONFIG.truncation,
            "fusion_depth_limit": _REFUSION_CONFIG.depth_limit,
            "point_voxel": _POINT_VOXEL,
            "normal_samples": _NORMAL_SAMPLES,
            "thresholds": [_THRESHOLD],
        },
        skipped={
            id: "missing" if id not in matched.matches else "F is 0"
            for id, row in objects.items()
            if not row[f"f_score_{_THRESHOLD:g}"] > 0
        },
    )


def voxel_means(points: Float64[np.ndarray, "n 3"], voxel: float) -> Float64[np.ndarray, "m 3"]:
    """The mean of the points in each voxel; the grid begins half a voxel below the least corner, as Open3D's does."""
    if len(points) == 0:
        return points
    cells = np.floor((points - (points.min(axis=0) - voxel / 2)) / voxel).astype(np.int64)
    _, place, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    sums = [np.bincount(place.ravel(), weights=points[:, axis], minlength=len(counts)) for axis in range(3)]
    return np.stack(sums, axis=1) / counts[:, None]


def _scores(predicted: Mesh | None, truth: Mesh, cameras: tuple[Camera, ...], seed: int) -> dict[str, float]:
    true = fuse_renders(truth, cameras, _REFUSION_CONFIG)
    found = None if predicted is None else fuse_renders(predicted, cameras, _REFUSION_CONFIG)
    name, nan = f"{_THRESHOLD:g}", float("nan")
    if found is None or not has_surface(found) or not has_surface(true):
        lengths = dict.fromkeys(("accuracy", "completion", "chamfer"), nan)
        shares = dict.fromkeys((f"f_score_{name}", f"precision_{name}", f"recall_{name}", "normal_consistency"), 0.0)
        return lengths | shares
    a = voxel_means(found.vertices.astype(np.float64), _POINT_VOXEL)
    b = voxel_means(true.vertices.astype(np.float64), _POINT_VOXEL)
    there, back = cKDTree(b).query(a)[0], cKDTree(a).query(b)[0]
    precision, recall = float((there < _THRESHOLD).mean()), float((back < _THRESHOLD).mean())
    return {
        "accuracy": float(there.mean()),
        "completion": float(back.mean()),
        "chamfer": float(there.mean() + back.mean()) / 2,
        f"f_score_{name}": 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0,
        f"precision_{name}": precision,
        f"recall_{name}": recall,
        "normal_consistency": _normals(found, true, seed) if precision + recall > 0 else 0.0,
    }


def _normals(found: Mesh, true: Mesh, seed: int) -> float:
    samples = [sample_surface(mesh, _NORMAL_SAMPLES, seed + turn) for turn, mesh in enumerate((found, true))]
    return surface_scores(samples[0], samples[1]).normal_consistency


def joined(meshes: list[Mesh]) -> Mesh:
    """One mesh of several, colours left out."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + np.int32(offset) for mesh, offset in zip(meshes, offsets, strict=False)]
    return Mesh(vertices=np.concatenate([mesh.vertices for mesh in meshes]), faces=np.concatenate(faces))
