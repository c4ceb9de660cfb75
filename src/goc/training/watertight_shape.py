"""A watertight training shape: signed distance on a grid, with its mesh and a scene to cast rays at."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from torch.nn import functional

from goc.evaluation.metrics import SurfaceSamples, sample_surface
from goc.geometry.isosurface import grid_surface
from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh
from goc.training.primitives import Number, Primitive, Triple

BAND = 4.0
"""Distance, in voxels, at which a shape's signed distance is cut off."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WatertightShape:
    """A closed shape in its own frame: longest side 1, z up, standing on z = 0, its box centred over the origin."""

    distance: Float32[np.ndarray, "x y z"]
    """Signed, negative inside, cut off at BAND voxels; exact at the grid's points."""
    origin: Float64[np.ndarray, "3"]
    """Position of distance[0, 0, 0]."""
    voxel: float

    @cached_property
    def mesh(self) -> Mesh:
        """The surface, closed."""
        vertices, faces = grid_surface(self.distance, self.origin, self.voxel)
        return Mesh(vertices=vertices, faces=faces)

    @cached_property
    def scene(self) -> TriangleScene:
        """The surface, for rays."""
        return TriangleScene(self.mesh.vertices, self.mesh.faces)

    def surface(self, count: int, seed: int) -> SurfaceSamples:
        """Area-uniform samples with outward normals."""
        return sample_surface(self.mesh, count, seed)

    def distances(self, points: Float[np.ndarray, "p 3"]) -> Float32[np.ndarray, "p"]:
        """Signed distance anywhere, trilinear in the grid; beyond the grid the cut-off value."""
        shape = np.array(self.distance.shape)
        at = (points - self.origin) / self.voxel / (shape - 1) * 2 - 1
        where = torch.from_numpy(at[:, ::-1].astype(np.float32).copy())[None, :, None, None]
        grid = torch.from_numpy(self.distance)[None, None]
        found = functional.grid_sample(grid, where, padding_mode="border", align_corners=True)
        return found[0, 0, :, 0, 0].numpy()


@dataclass(frozen=True, kw_only=True, eq=False)
class CsgPart:
    """A primitive with its pose, and the boolean operation by which it joins the parts before it."""

    body: Primitive
    at: Triple
    """Position of the primitive's origin, frame of the shape."""
    turn: Float[np.ndarray, "3 3"] | None = None
    """Rotation shape_from_body; None: aligned."""
    operation: Literal["union", "difference", "intersection"] = "union"
    """Union, difference, or intersection."""
    blend: Number = 0.0
    """Radius of the fillet where an added body meets the rest."""

    def box(self) -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
        """Corners of an aligned box that holds the part."""
        half = np.array(self.body.half_extent(), np.float64)
        reach = half if self.turn is None else np.abs(self.turn) @ half
        at = np.array(self.at, np.float64)
        return at - reach, at + reach


def shape_from_parts(parts: Sequence[CsgPart], cells: int) -> WatertightShape | None:
    """Apply parts to a signed distance grid, one after the other, each only where it can reach.

    Args:
        parts: in any unit and place; the shape is brought into the frame of a WatertightShape.
        cells: along its longest side.

    Returns:
        None where fewer than 64 voxels are inside.
    """
    boxes = [part.box() for part in parts if part.operation == "union"]
    low, high = np.min([box[0] for box in boxes], 0), np.max([box[1] for box in boxes], 0)
    voxel = float((high - low).max()) / cells
    rim = BAND + 1
    shape = np.ceil((high - low) / voxel + 2 * rim).astype(int) + 1
    origin = low - rim * voxel
    field = np.full(shape, np.float32(BAND * voxel), np.float32)
    for part in parts:
        _apply_part(field, origin, voxel, part)
    return _normalised(field, origin, voxel)


def _apply_part(field: Float32[np.ndarray, "x y z"], origin: np.ndarray, voxel: float, part: CsgPart) -> None:
    low, high = part.box()
    reach = BAND * voxel + part.blend
    first = np.clip(np.floor((low - reach - origin) / voxel).astype(int), 0, field.shape)
    last = np.clip(np.ceil((high + reach - origin) / voxel).astype(int) + 1, 0, field.shape)
    block = tuple(slice(a, b) for a, b in zip(first, last, strict=True))
    if (last <= first).any():
        return
    ends = zip(first, last, strict=True)
    lines = [(origin[axis] - part.at[axis] + voxel * np.arange(a, b)) for axis, (a, b) in enumerate(ends)]
    x, y, z = (
        line.astype(np.float32).reshape([-1 if axis == other else 1 for other in range(3)])
        for axis, line in enumerate(lines)
    )
    if part.turn is not None:
        turn = part.turn.astype(np.float32)
        x, y, z = (x * turn[0, i] + y * turn[1, i] + z * turn[2, i] for i in range(3))
    distance = part.body.distance(x, y, z)
    here = field[block]
    match part.operation:
        case "union" if part.blend > 0:
            field[block] = _smooth_union(here, distance, part.blend)
        case "union":
            field[block] = np.minimum(here, distance)
        case "difference":
            field[block] = np.maximum(here, -distance)
        case "intersection":
            kept = np.maximum(here, distance)
            field[:] = BAND * voxel
            field[block] = kept


def _smooth_union(a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    """Polynomial smooth minimum (Quilez): a fillet of about this radius."""
    share = np.maximum(radius - np.abs(a - b), 0) / np.float32(radius)
    return np.minimum(a, b) - share**2 * np.float32(radius / 4)


def _normalised(field: Float32[np.ndarray, "x y z"], origin: np.ndarray, voxel: float) -> WatertightShape | None:
    """Crop to what is there, scale the longest side to 1, stand on z = 0, centre over the origin."""
    inside = field < 0
    if inside.sum() < 64:
        return None
    low, high = [], []
    for axis in range(3):
        rows = np.flatnonzero(inside.any(axis=tuple(other for other in range(3) if other != axis)))
        low.append(rows[0])
        high.append(rows[-1])
    rim = int(BAND)
    first, last = np.maximum(np.array(low) - rim, 0), np.minimum(np.array(high) + rim + 1, field.shape)
    cropped = field[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
    size = (np.array(high) - np.array(low) + 1) * voxel
    scale = 1.0 / size.max()
    foot = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2] - 0.5])
    return WatertightShape(
        distance=np.ascontiguousarray(np.clip(cropped, -BAND * voxel, BAND * voxel)) * np.float32(scale),
        origin=(first - foot) * voxel * scale,
        voxel=float(voxel * scale),
    )
