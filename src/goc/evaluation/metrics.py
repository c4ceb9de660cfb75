"""Metrics of surfaces (accuracy, completion, chamfer, F-score, normals) and of images (PSNR, SSIM).

The protocol: both surfaces are 30,000 area-uniform samples with normals; distances go from each sample to the nearest
sample of the other side (never to vertices: those reward dense tessellation). At that density half a spacing remains
between samples of the very same surface (8 mm on a sofa of 8 m²), so figures compare only at the same counts.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64
from scipy.spatial import cKDTree
from torch import Tensor

from goc.scene import Mesh

SAMPLES = 30_000


@dataclass(frozen=True, kw_only=True, eq=False)
class SurfaceSamples:
    """Points on a surface with unit normals."""

    points: Float64[np.ndarray, "p 3"]
    normals: Float64[np.ndarray, "p 3"]

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, kw_only=True)
class SurfaceScores:
    """Agreement of a predicted surface with the true one. Lengths in the units of the samples (metres in goc)."""

    accuracy: float
    """Mean distance from predicted samples to the truth; NaN where nothing was predicted."""
    completion: float
    """Mean distance from true samples to the prediction; infinite where nothing was predicted."""
    chamfer: float
    """(accuracy + completion) / 2, the paper's CD: unsquared, halved."""
    f_score: dict[float, float]
    """Harmonic mean of precision and recall at each threshold."""
    precision: dict[float, float]
    """Share of predicted samples nearer to the truth than each threshold."""
    recall: dict[float, float]
    """Share of true samples nearer to the prediction than each threshold."""
    normal_consistency: float
    """Mean |cos| between normals of nearest samples, both ways averaged."""
    completion_seen: float = float("nan")
    """Completion over the true samples that some view saw; NaN where the split is unknown or empty."""
    completion_unseen: float = float("nan")
    accuracy_seen: float = float("nan")
    """Accuracy over the predicted samples whose nearest true sample some view saw."""
    accuracy_unseen: float = float("nan")


def sample_surface(mesh: Mesh, count: int = SAMPLES, seed: int = 0) -> SurfaceSamples:
    """Area-uniform samples with face normals, stratified over the total area; the same for the same seed.

    Raises:
        ValueError: the mesh has no area.
    """
    corners = mesh.vertices[mesh.faces].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    total = np.cumsum(doubled)
    if len(total) == 0 or not total[-1] > 0:
        raise ValueError(f"A mesh of {len(mesh.faces)} faces has no area to sample.")
    random = np.random.default_rng(seed)
    at = (np.arange(count) + random.random(count)) / count * total[-1]
    face = np.minimum(np.searchsorted(total, at, side="right"), np.flatnonzero(doubled)[-1])
    root, share = np.sqrt(random.random((count, 1))), random.random((count, 1))
    a, b, c = corners[face].transpose(1, 0, 2)
    return SurfaceSamples(
        points=(1 - root) * a + root * (1 - share) * b + root * share * c,
        normals=cross[face] / doubled[face, None],
    )


def surface_scores(
    predicted: SurfaceSamples | None,
    truth: SurfaceSamples,
    thresholds: tuple[float, ...] = (0.05, 0.01),
    seen: Bool[np.ndarray, "p"] | None = None,
) -> SurfaceScores:
    """Score a predicted surface; `None` (a missing object) scores F = 0, NC = 0, completion infinite, accuracy NaN.

    Args:
        predicted: Samples of the prediction, None where there is none.
        truth: Samples of the true surface.
        thresholds: Distances at which F is taken, in the samples' units.
        seen: Which true samples some view saw; splits accuracy and completion.
    """
    if predicted is None or len(predicted) == 0:
        return SurfaceScores(
            accuracy=float("nan"),
            completion=float("inf"),
            chamfer=float("inf"),
            f_score=dict.fromkeys(thresholds, 0.0),
            precision=dict.fromkeys(thresholds, 0.0),
            recall=dict.fromkeys(thresholds, 0.0),
            normal_consistency=0.0,
        )
    to_truth, at_truth = cKDTree(truth.points).query(predicted.points)
    to_predicted, at_predicted = cKDTree(predicted.points).query(truth.points)
    forth = np.abs((predicted.normals * truth.normals[at_truth]).sum(axis=1)).mean()
    back = np.abs((truth.normals * predicted.normals[at_predicted]).sum(axis=1)).mean()
    return SurfaceScores(
        accuracy=float(to_truth.mean()),
        completion=float(to_predicted.mean()),
        chamfer=float(to_truth.mean() + to_predicted.mean()) / 2,
        f_score={t: _f_score(to_truth < t, to_predicted < t) for t in thresholds},
        precision={t: float((to_truth < t).mean()) for t in thresholds},
        recall={t: float((to_predicted < t).mean()) for t in thresholds},
        normal_consistency=float(forth + back) / 2,
        completion_seen=_mean(to_predicted, seen),
        completion_unseen=_mean(to_predicted, None if seen is None else ~seen),
        accuracy_seen=_mean(to_truth, None if seen is None else seen[at_truth]),
        accuracy_unseen=_mean(to_truth, None if seen is None else ~seen[at_truth]),
    )


def psnr(image: Float[Tensor, "h w 3"], truth: Float[Tensor, "h w 3"]) -> float:
    """Peak signal-to-noise ratio of images in [0, 1], dB; infinite where they are equal."""
    return float(-10.0 * torch.log10((image.double() - truth.double()).square().mean()))


def ssim(image: Float[Tensor, "h w 3"], truth: Float[Tensor, "h w 3"]) -> float:
    """Structural similarity (Wang et al. 2004) of images in [0, 1]: 11×11 Gaussian window, σ = 1.5, whole windows only.

    Raises:
        ValueError: an image smaller than the window.
    """
    if min(image.shape[:2]) < 11:
        raise ValueError(f"SSIM needs 11x11 pixels or more, not {image.shape[0]}x{image.shape[1]}.")
    offset = torch.arange(11, dtype=torch.float64) - 5
    window = torch.exp(-offset.square() / (2 * 1.5**2))
    window = window / window.sum()
    a, b = (x.double().permute(2, 0, 1)[:, None] for x in (image, truth))

    def blur(x: Tensor) -> Tensor:
        across = torch.nn.functional.conv2d(x, window.view(1, 1, 1, 11))
        return torch.nn.functional.conv2d(across, window.view(1, 1, 11, 1))

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b = blur(a * a) - mean_a.square(), blur(b * b) - mean_b.square()
    shared = blur(a * b) - mean_a * mean_b
    c1, c2 = 0.01**2, 0.03**2
    likeness = (2 * mean_a * mean_b + c1) * (2 * shared + c2)
    return float((likeness / ((mean_a.square() + mean_b.square() + c1) * (var_a + var_b + c2))).mean())


def _f_score(precise: Bool[np.ndarray, "p"], recalled: Bool[np.ndarray, "q"]) -> float:
    precision, recall = float(precise.mean()), float(recalled.mean())
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def _mean(distances: Float64[np.ndarray, "p"], where: Bool[np.ndarray, "p"] | None) -> float:
    return float("nan") if where is None or not where.any() else float(distances[where].mean())
