"""Materials of meshes read from files: their texture coordinates are places in an image, or colours."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from goc.files.any_mesh import MeshPiece, sample_texture
from goc.files.colour import decode_srgb
from goc.synth.materials import Appearance, Points

GREY = (0.5, 0.5, 0.5)
"""Linear reflectance of meshes without colours."""
# A diffuse surface that throws back more than this much light does not exist, and would wash out.
_BRIGHTEST = 0.85


@dataclass(frozen=True, eq=False)
class ImageTexture:
    """An image as albedo; points are (u, v, anything)."""

    image: UInt8[np.ndarray, "h w 3"]

    def appearance(self, points: Points) -> Appearance:
        """Bilinear samples."""
        return Appearance(colour=np.minimum(sample_texture(self.image, points[:, :2]), _BRIGHTEST))


@dataclass(frozen=True, eq=False)
class VertexColours:
    """Colours at the vertices: texture coordinates are linear colours, interpolated between the corners."""

    def appearance(self, points: Points) -> Appearance:
        """The points, as colours."""
        return Appearance(colour=np.clip(points, 0.0, _BRIGHTEST).astype(np.float32))


def material_of(piece: MeshPiece) -> tuple[ImageTexture | VertexColours, Points]:
    """The material of a piece, and its texture coordinates at the vertices."""
    count = len(piece.mesh.vertices)
    if piece.texture is not None and piece.uv is not None:
        return ImageTexture(piece.texture), np.concatenate([piece.uv, np.zeros((count, 1))], -1).astype(np.float64)
    if piece.mesh.colours is not None:
        return VertexColours(), decode_srgb(piece.mesh.colours)
    return VertexColours(), np.broadcast_to(np.array(GREY), (count, 3)).copy()
