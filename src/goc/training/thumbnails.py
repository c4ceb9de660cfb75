"""Small pictures of shapes, so that a person can see what a network does."""

import numpy as np
from jaxtyping import Float, UInt8

from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh

_TOWARDS = np.array([-0.55, -0.75, 0.5])
"""Direction from the shape to the eye, of any length."""
_BLANK = 245
_HALF = 1.05
"""Half the width of the picture, model units."""


def shaded(
    mesh: Mesh, size: int = 128, colour: tuple[float, float, float] = (0.75, 0.8, 0.9)
) -> UInt8[np.ndarray, "h w 3"]:
    """A mesh in model units, [-1, 1]³, seen from above its front left, lit from the eye; white where nothing is."""
    picture = np.full((size, size, 3), _BLANK, np.uint8)
    if len(mesh.faces) == 0:
        return picture
    towards, right, up = _axes()
    steps = ((np.arange(size) + 0.5) / size * 2 - 1) * _HALF * 1.35
    origins = 4.0 * towards + steps[None, :, None] * right - steps[:, None, None] * up
    hits = TriangleScene(mesh.vertices, mesh.faces).closest_hit(
        origins.reshape(-1, 3), np.broadcast_to(-towards, (size * size, 3))
    )
    corners = mesh.vertices[mesh.faces[np.maximum(hits.triangle, 0)]].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    light = 0.25 + 0.6 * np.clip(normals @ towards, 0, 1) + 0.15 * np.clip(normals[:, 2], 0, 1)
    shade = np.clip(255 * light[:, None] * np.array(colour), 0, 255).astype(np.uint8)
    return np.where(hits.found[:, None], shade, _BLANK).astype(np.uint8).reshape(size, size, 3)


def tiled(rows: list[list[UInt8[np.ndarray, "h w 3"]]]) -> UInt8[np.ndarray, "hh ww 3"]:
    """Pictures of one size in rows."""
    return np.concatenate([np.concatenate(row, 1) for row in rows], 0)


def _axes() -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    towards = _TOWARDS / np.linalg.norm(_TOWARDS)
    right = np.cross([0, 0, 1.0], towards)
    right /= np.linalg.norm(right)
    return towards, right, np.cross(towards, right)
