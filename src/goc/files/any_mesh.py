"""Meshes as other tools write them: GLB and OBJ with textures, PLY. The only module that knows trimesh."""

import io
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, UInt8

from goc.errors import FileError
from goc.files.colour import decode_srgb, encode_srgb
from goc.files.meshes import check_mesh, read_mesh
from goc.files.reading import brief, read_bytes
from goc.scene import Mesh

if TYPE_CHECKING:
    from trimesh import Trimesh

MESH_SUFFIXES = (".glb", ".obj", ".ply")
"""What can be read."""

_LIMIT = 1 << 30
_MID_GREY = 128
_LINEAR = decode_srgb(np.arange(256, dtype=np.uint8)).astype(np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class MeshPiece:
    """A mesh with at most one texture. Where the texture has seams, vertices are repeated."""

    mesh: Mesh
    uv: Float32[np.ndarray, "v 2"] | None = None
    """Place in the texture, (0, 0) at its lower left corner; the texture repeats beyond 0…1."""
    texture: UInt8[np.ndarray, "h w 3"] | None = None
    """sRGB; its first row is the upper one."""


def read_any_mesh(path: Path, weld: bool = False) -> Mesh:
    """Read a .glb, .obj or .ply file as one mesh, with colours at the vertices where the file has any kind of colour.

    Args:
        path: all meshes of the file's scene are taken, each where the scene puts it; axes and units stay the file's.
        weld: make vertices at the same place one, as geometry needs; textures' seams repeat them.

    Raises:
        FileError: missing, damaged, of another format, without faces, or with positions that are not finite.
    """
    pieces = read_mesh_pieces(path)
    starts = np.cumsum([0] + [len(piece.mesh.vertices) for piece in pieces])
    colours = [_vertex_colours(piece) for piece in pieces]
    known = any(each is not None for each in colours)
    grey = [np.full((len(piece.mesh.vertices), 3), _MID_GREY, np.uint8) for piece in pieces]
    filled = [other if each is None else each for each, other in zip(colours, grey, strict=True)]
    mesh = Mesh(
        vertices=np.concatenate([piece.mesh.vertices for piece in pieces]),
        faces=np.concatenate([piece.mesh.faces + start for piece, start in zip(pieces, starts, strict=False)]).astype(
            np.int32
        ),
        colours=np.concatenate(filled) if known else None,
    )
    return welded(mesh) if weld else mesh


def welded(mesh: Mesh) -> Mesh:
    """Make vertices at exactly the same place one (the first's colour stays), and drop faces that thereby collapse."""
    _, first, index = np.unique(mesh.vertices, axis=0, return_index=True, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces].astype(np.int32)
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    colours = None if mesh.colours is None else mesh.colours[first]
    return Mesh(vertices=mesh.vertices[first], faces=faces[whole], colours=colours)


def sample_texture(texture: UInt8[np.ndarray, "h w 3"], uv: Float[np.ndarray, "p 2"]) -> Float32[np.ndarray, "p 3"]:
    """Linear light of a repeating texture, interpolated bilinearly between the middles of its pixels."""
    height, width = texture.shape[:2]
    column, row = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, above = np.floor(column), np.floor(row)
    right_share, below_share = (column - left).astype(np.float32), (row - above).astype(np.float32)
    total = np.zeros((len(uv), 3), np.float32)
    for down, row_share in ((0, 1 - below_share), (1, below_share)):
        for across, column_share in ((0, 1 - right_share), (1, right_share)):
            texels = texture[(above.astype(np.int64) + down) % height, (left.astype(np.int64) + across) % width]
            total += (row_share * column_share)[:, None] * _LINEAR[texels]
    return total


def read_mesh_pieces(path: Path) -> tuple[MeshPiece, ...]:
    """Read a .glb, .obj or .ply file, each textured part on its own.

    Materials are reduced to their base colour; transparency is ignored. An OBJ's materials and textures are read from
    its own folder or below, nothing from a network.

    Raises:
        FileError: as read_any_mesh.
    """
    suffix = path.suffix.lower()
    if suffix == ".ply":
        return (MeshPiece(mesh=read_mesh(path)),)
    if suffix not in MESH_SUFFIXES:
        raise FileError(f"{path}: not a mesh that goc reads. Convert it to one of {', '.join(MESH_SUFFIXES)}.")
    data = read_bytes(path, _LIMIT)
    try:
        pieces = _pieces(path, data, suffix[1:])
    except FileError:
        raise
    except Exception as error:  # trimesh raises whatever its parsers and numpy do
        raise FileError(
            f"{path}: not a readable {suffix[1:].upper()} file ({brief(error)}). Write it again."
        ) from error
    if not pieces:
        raise FileError(f"{path}: holds no faces. Expected a mesh.")
    return pieces


def _pieces(path: Path, data: bytes, kind: str) -> tuple[MeshPiece, ...]:
    import trimesh
    from trimesh.resolvers import FilePathResolver

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scene = trimesh.load_scene(
            io.BytesIO(data), file_type=kind, resolver=FilePathResolver(str(path)), process=False
        )
        pieces = []
        for node in scene.graph.nodes_geometry:
            pose, name = scene.graph[node]
            part = scene.geometry[name]
            if isinstance(part, trimesh.Trimesh) and len(part.faces):
                pieces.append(_piece(path, part, np.asarray(pose, np.float64)))
    return tuple(pieces)


def _piece(path: Path, part: "Trimesh", pose: Float[np.ndarray, "4 4"]) -> MeshPiece:
    """One part, placed in the scene."""
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = (np.asarray(part.vertices) @ pose[:3, :3].T + pose[:3, 3]).astype(np.float32)
    faces = np.asarray(part.faces).astype(np.int32)
    check_mesh(path, vertices, faces)
    if np.linalg.det(pose[:3, :3]) < 0:
        faces = faces[:, ::-1]
    match part.visual.kind:
        case "texture":
            return _textured(vertices, faces, part.visual)
        case "vertex":
            return _coloured(vertices, faces, np.asarray(part.visual.vertex_colors)[:, :3])
        case "face":  # each face gets its own corners
            colours = np.repeat(np.asarray(part.visual.face_colors)[:, :3], 3, axis=0)
            return _coloured(vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3), colours)
    return MeshPiece(mesh=Mesh(vertices=vertices, faces=np.ascontiguousarray(faces)))


def _coloured(vertices: np.ndarray, faces: np.ndarray, colours: np.ndarray) -> MeshPiece:
    mesh = Mesh(
        vertices=np.ascontiguousarray(vertices),
        faces=np.ascontiguousarray(faces, np.int32),
        colours=np.ascontiguousarray(colours, np.uint8),
    )
    return MeshPiece(mesh=mesh)


def _textured(vertices: np.ndarray, faces: np.ndarray, visual: Any) -> MeshPiece:
    """A material's texture, or its one colour."""
    material = visual.material
    is_gltf = hasattr(material, "baseColorFactor")
    image = material.baseColorTexture if is_gltf else getattr(material, "image", None)
    factor = material.baseColorFactor if is_gltf else getattr(material, "diffuse", None)
    tint = np.full(3, 255) if factor is None else np.asarray(factor).reshape(-1)[:3]
    light = tint / 255 if is_gltf else decode_srgb(tint.astype(np.uint8))  # glTF's factors are linear
    mesh = Mesh(vertices=vertices, faces=np.ascontiguousarray(faces))
    uv = None if visual.uv is None else np.asarray(visual.uv, np.float32)
    if image is None or uv is None or len(uv) != len(vertices) or not np.isfinite(uv).all():
        return _coloured(vertices, faces, np.broadcast_to(encode_srgb(light), (len(vertices), 3)))
    texture = np.array(image.convert("RGB"))
    if is_gltf and (light != 1).any():  # of an OBJ, the texture stands in the colour's place
        texture = encode_srgb(_LINEAR[texture] * light)
    return MeshPiece(mesh=mesh, uv=np.ascontiguousarray(uv[:, :2]), texture=texture)


def _vertex_colours(piece: MeshPiece) -> UInt8[np.ndarray, "v 3"] | None:
    if piece.texture is None or piece.uv is None:
        return piece.mesh.colours
    return encode_srgb(sample_texture(piece.texture, piece.uv))
