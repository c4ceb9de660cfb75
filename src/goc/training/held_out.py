"""Completions of shapes that were not trained on, scored against the truth beside what needs no training."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32
from scipy.spatial import ConvexHull, Delaunay, QhullError

from goc.complete import Completer, Cube, cell_centres, evidence_channels
from goc.evaluation.metrics import SurfaceSamples, sample_surface, surface_scores
from goc.geometry.isosurface import grid_surface
from goc.scene import Mesh
from goc.training.masking import MaskConfig, Masked, mask
from goc.training.pictures import shaded
from goc.training.samples import Draw, true_distance

Field = Float32[np.ndarray, "n n n"]
"""Positive outside, its zero level the surface; model units near the surface."""

_SEEN = 0.3
"""Share of a cell in the band of a seen surface from which the measured distance holds."""
_SOFT = 0.004
"""Model units that one unit of log-odds counts for when a field is meshed."""
SAMPLES = 20_000
F_AT = 0.02
"""Threshold of F, in longest sides of the true box."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One masked object on a lattice, with its truth."""

    masked: Masked
    channels: Float32[np.ndarray, "c n n n"]
    truth: Field

    @property
    def decided(self) -> Bool[np.ndarray, "n n n"]:
        """Cells that rays decided: surface seen, or seen empty."""
        return (self.channels[1] >= _SEEN) | (self.channels[2] >= 0.5)

    def composed(self, guess: Field) -> Field:
        """A guess where nothing is known; measured distance where surface was seen; outside where rays passed."""
        band = 1.5 * 2.0 / self.truth.shape[0]
        known = np.where(self.channels[1] >= _SEEN, self.channels[0] * band, np.maximum(guess, band / 2))
        return np.where(self.decided, known, guess).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class Score:
    """One completion against the truth. Lengths in longest sides of the true box."""

    iou: float
    chamfer_mean: float
    """(accuracy + completion) / 2, as in the paper's tables of rooms."""
    chamfer_sum: float
    """accuracy + completion, as in 3DShape2VecSet."""
    f_score: float
    """At 2 % of the longest side."""
    normal_consistency: float
    decided_right: float
    """Share of undecided cells of the true box that are called rightly."""


def held_out_cases(draw: Draw, count: int, masking: MaskConfig, cells: int, seed: Sequence[int]) -> Iterator[Case]:
    """`count` masked shapes, the same for the same seed."""
    number = made = 0
    while made < count:
        random = np.random.default_rng([*seed, number])
        masked = mask(draw(random), masking, random)
        number += 1
        if masked is not None:
            made += 1
            yield case_of(masked, cells)


def case_of(masked: Masked, cells: int) -> Case:
    """A masked object on a lattice of `cells`³."""
    centres = cell_centres(cells).reshape(-1, 3)
    truth = true_distance(masked, centres).reshape((cells,) * 3)
    return Case(masked=masked, channels=evidence_channels(masked.partial.evidence, cells), truth=truth)


def guess_nothing(case: Case) -> Field:
    """What was not seen is not there."""
    return np.full_like(case.truth, 0.02)


def guess_hull(case: Case) -> Field:
    """What no ray passed is solid, within the box of the evidence (research: the evidence hull)."""
    empty, beyond = case.channels[2], case.channels[3]
    return ((empty + beyond - 0.5) * 0.04).astype(np.float32)


def guess_convex(case: Case) -> Field:
    """The convex hull of what was seen."""
    cells = case.truth.shape[0]
    centres = cell_centres(cells)
    seen = centres[(case.channels[1] >= _SEEN) & (case.channels[0] <= 0)]
    try:
        corners = seen[ConvexHull(seen).vertices]
        inside = Delaunay(corners).find_simplex(centres.reshape(-1, 3)) >= 0
    except (QhullError, ValueError):
        return guess_nothing(case)
    return np.where(inside.reshape(case.truth.shape), -0.02, 0.02).astype(np.float32)


def guess_network(case: Case, network: Completer, threshold: float) -> Field:
    """What a network says, its level at occupancy `threshold`."""
    cells = case.truth.shape[0]
    centres = torch.from_numpy(cell_centres(cells).reshape(-1, 3))
    logits = network.complete(case.masked.partial).logits(centres).float().cpu().numpy()
    level = np.log(threshold / (1 - threshold))
    return np.clip((level - logits) * _SOFT, -0.04, 0.04).astype(np.float32).reshape(case.truth.shape)


def score(case: Case, field: Field, with_surface: bool = True) -> Score:
    """Compare a field with the truth of its case; without the surface's scores in a tenth of the time."""
    inside, truth = field < 0, case.truth < 0
    iou = float((inside & truth).sum() / max((inside | truth).sum(), 1))
    rows = [np.flatnonzero(truth.any(axis=tuple(o for o in range(3) if o != axis))) for axis in range(3)]
    box = tuple(slice(row[0], row[-1] + 1) if len(row) else slice(0, 0) for row in rows)
    open_ = ~case.decided[box]
    right = float((inside[box] == truth[box])[open_].mean()) if open_.any() else 1.0
    nothing = float("nan")
    if not with_surface:
        return Score(
            iou=iou,
            chamfer_mean=nothing,
            chamfer_sum=nothing,
            f_score=nothing,
            normal_consistency=nothing,
            decided_right=right,
        )
    points, normals = case.masked.placed.surface(SAMPLES, 1)
    cube = case.masked.cube
    true = SurfaceSamples(points=points, normals=normals)
    longest = float(np.ptp(points, axis=0).max())
    found = surface_scores(_samples(field, cube), true, thresholds=(F_AT * longest,))
    return Score(
        iou=iou,
        chamfer_mean=found.chamfer / longest,
        chamfer_sum=2 * found.chamfer / longest,
        f_score=next(iter(found.f_score.values())),
        normal_consistency=found.normal_consistency,
        decided_right=right,
    )


def surface_of(field: Field) -> Mesh:
    """The zero level of a field, model units, closed."""
    cells = field.shape[0]
    vertices, faces = grid_surface(field, np.full(3, 1.0 / cells - 1.0), 2.0 / cells)
    return Mesh(vertices=vertices, faces=faces)


def show(case: Case, fields: Sequence[Field], size: int = 128) -> list[np.ndarray]:
    """Pictures of what was seen, of each field, and of the truth."""
    seen = case.composed(guess_nothing(case))
    blue, green, grey = (0.75, 0.8, 0.9), (0.65, 0.8, 0.65), (0.85, 0.85, 0.85)
    pictures = [shaded(surface_of(seen), size, green)]
    pictures += [shaded(surface_of(field), size, blue) for field in fields]
    return [*pictures, shaded(surface_of(case.truth), size, grey)]


def _samples(field: Field, cube: Cube) -> SurfaceSamples | None:
    mesh = surface_of(field)
    if len(mesh.faces) == 0:
        return None
    moved = Mesh(vertices=cube.world_from_model(mesh.vertices), faces=mesh.faces)
    return sample_surface(moved, SAMPLES)
