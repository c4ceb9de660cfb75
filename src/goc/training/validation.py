"""Validation during training: completions of shapes that are not trained on, scored on the grid of the network.

Quick enough for every few hundred steps; `goc osc eval` composes and meshes as `goc carve` does.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32

from goc.complete import Completer, cell_centres, evidence_channels
from goc.geometry.isosurface import grid_surface
from goc.scene import Mesh
from goc.training.masking import MaskConfig, MaskedObject, mask
from goc.training.samples import Draw, true_distance
from goc.training.thumbnails import shaded

Field = Float32[np.ndarray, "n n n"]
"""Signed distance at the cells of a grid, positive outside, in model units near the surface."""

_SEEN = 0.3
"""A cell with at least this share of it in the band of a seen surface takes the measured distance."""
_SOFT = 0.004
"""Model units of distance per unit of log-odds, when a network's answer is made a signed distance."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ValidationCase:
    """One masked object on a grid of n³ cells: its evidence, and its true signed distance."""

    masked: MaskedObject
    channels: Float32[np.ndarray, "c n n n"]
    truth: Field

    @property
    def decided(self) -> Bool[np.ndarray, "n n n"]:
        """Cells that rays decided: surface seen, or seen empty."""
        return (self.channels[1] >= _SEEN) | (self.channels[2] >= 0.5)

    def composed(self, guess: Field) -> Field:
        """Combine a guess with the evidence: measured where surface was seen, outside where rays passed."""
        band = 1.5 * 2.0 / self.truth.shape[0]
        known = np.where(self.channels[1] >= _SEEN, self.channels[0] * band, np.maximum(guess, band / 2))
        return np.where(self.decided, known, guess).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class OccupancyScore:
    """How well one completion's inside and outside agree with the truth."""

    iou: float
    """Volume in both over volume in either, 0 to 1."""
    unknown_accuracy: float
    """Share of the undecided points of the true box that are called rightly; 1 where there are none."""


def validation_cases(
    draw: Draw, count: int, masking: MaskConfig, cells: int, seed: Sequence[int]
) -> Iterator[ValidationCase]:
    """`count` masked shapes, the same for the same seed."""
    number = made = 0
    while made < count:
        random = np.random.default_rng([*seed, number])
        masked = mask(draw(random), masking, random)
        number += 1
        if masked is not None:
            made += 1
            yield case_of(masked, cells)


def case_of(masked: MaskedObject, cells: int) -> ValidationCase:
    """A masked object on a grid of `cells`³."""
    centres = cell_centres(cells).reshape(-1, 3)
    truth = true_distance(masked, centres).reshape((cells,) * 3)
    return ValidationCase(masked=masked, channels=evidence_channels(masked.partial.evidence, cells), truth=truth)


def guess_nothing(case: ValidationCase) -> Field:
    """The guess that there is nothing but what was seen: outside everywhere."""
    return np.full_like(case.truth, 0.02)


def guess_network(case: ValidationCase, network: Completer, threshold: float) -> Field:
    """A network's answer, as a field whose zero level is where the occupancy is `threshold`."""
    cells = case.truth.shape[0]
    centres = torch.from_numpy(cell_centres(cells).reshape(-1, 3))
    logits = network.complete(case.masked.partial).logits(centres).float().cpu().numpy()
    level = np.log(threshold / (1 - threshold))
    return np.clip((level - logits) * _SOFT, -0.04, 0.04).astype(np.float32).reshape(case.truth.shape)


def score(case: ValidationCase, field: Field) -> OccupancyScore:
    """Compare a field with the truth of its case, cell by cell; the true box is that of the truth's inside cells."""
    truth = case.truth < 0
    rows = [np.flatnonzero(truth.any(axis=tuple(o for o in range(3) if o != axis))) for axis in range(3)]
    box = tuple(slice(row[0], row[-1] + 1) if len(row) else slice(0, 0) for row in rows)
    undecided = np.zeros_like(truth)
    undecided[box] = ~case.decided[box]
    return occupancy_score(field < 0, truth, undecided)


def occupancy_score(
    inside: Bool[np.ndarray, "*p"], truth: Bool[np.ndarray, "*p"], undecided: Bool[np.ndarray, "*p"]
) -> OccupancyScore:
    """Score predicted occupancy at points spread evenly over the cube.

    Args:
        inside: which points the prediction calls inside.
        truth: which points are inside.
        undecided: points of the true box where neither seen surface nor a passing ray tells the answer.
    """
    iou = float((inside & truth).sum() / max((inside | truth).sum(), 1))
    accuracy = float((inside == truth)[undecided].mean()) if undecided.any() else 1.0
    return OccupancyScore(iou=iou, unknown_accuracy=accuracy)


def surface_of(field: Field) -> Mesh:
    """The zero level of a field, model units, closed."""
    cells = field.shape[0]
    vertices, faces = grid_surface(field, np.full(3, 1.0 / cells - 1.0), 2.0 / cells)
    return Mesh(vertices=vertices, faces=faces)


def preview(case: ValidationCase, fields: Sequence[Field], size: int = 128) -> list[np.ndarray]:
    """Pictures of what was seen, of each field, and of the truth."""
    seen = case.composed(guess_nothing(case))
    blue, green, grey = (0.75, 0.8, 0.9), (0.65, 0.8, 0.65), (0.85, 0.85, 0.85)
    pictures = [shaded(surface_of(seen), size, green)]
    pictures += [shaded(surface_of(field), size, blue) for field in fields]
    return [*pictures, shaded(surface_of(case.truth), size, grey)]
