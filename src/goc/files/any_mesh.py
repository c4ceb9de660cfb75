"""Meshes as other tools write them: glTF and OBJ with textures, PLY, STL, OFF. The only module that knows trimesh."""

import io
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32, Float64, Int64, UInt8

from goc.errors import FileError
from goc.files.colour import decode_srgb, encode_srgb
from goc.files.gltf import plain_glb
from goc.files.gltf_buffers import GltfError
from goc.files.images import MAX_PIXELS
from goc.files.meshes import check_mesh, read_mesh
from goc.files.offsets import recentred
from goc.files.raw_points import RawPoints
from goc.files.reading import brief, read_bytes
from goc.scene import Mesh

if TYPE_CHECKING:
    from PIL.Image import Image
    from trimesh import PointCloud, Scene, Trimesh

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
"""What can be read."""

_LIMIT = 1 << 30
_MID_GREY = 128
_MOST_CORNERS = 1 << 27
"""Vertices and corners of all placed meshes: a small file can name one mesh a thousand times."""
_NO_FACES = np.zeros((0, 3), np.int64)
_OBJ_FACE = re.compile(rb"^\s*f\s", re.MULTILINE)
_WIDEST_TEXTURE = 4096
"""Textures are scaled down to this many pixels a side: vertices and photographs see no more of them."""
_TEXTURES = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF")  # not EPS and the like, which start other programs
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
    """Read a file of MESH_SUFFIXES as one mesh, with colours at the vertices where the file has any kind of colour.

    Args:
        path: all meshes of the file's scene are taken, each where the scene puts it; axes and units stay the file's.
        weld: make vertices at the same place one, as geometry needs; textures' seams repeat them.

    Raises:
        FileError: missing, damaged, of another format, without faces, or with positions that are not finite.
    """
    mesh = _joined(read_mesh_pieces(path))
    return welded(mesh) if weld else mesh


def read_mesh_or_points(path: Path) -> tuple[Mesh, Float64[np.ndarray, "3"]] | RawPoints:
    """Read any format but PLY: a welded mesh about an origin that single precision can bear, or points without faces.

    Returns:
        The mesh, and where its origin lies in the file's frame (see `recentred`); or points as they are stored.

    Raises:
        FileError: as read_any_mesh.
    """
    parts = _placed_parts(path)
    with_faces = [part for part in parts if len(part.faces)]
    if not with_faces:
        return _points(path, parts)
    _, offset = recentred(path, np.concatenate([part.vertices for part in with_faces]))
    return welded(_joined(tuple(_piece(path, part, offset) for part in with_faces))), offset


def _joined(pieces: tuple[MeshPiece, ...]) -> Mesh:
    starts = np.cumsum([0] + [len(piece.mesh.vertices) for piece in pieces])
    colours = [_vertex_colours(piece) for piece in pieces]
    known = any(each is not None for each in colours)
    grey = [np.full((len(piece.mesh.vertices), 3), _MID_GREY, np.uint8) for piece in pieces]
    filled = [other if each is None else each for each, other in zip(colours, grey, strict=True)]
    return Mesh(
        vertices=np.concatenate([piece.mesh.vertices for piece in pieces]),
        faces=np.concatenate([piece.mesh.faces + start for piece, start in zip(pieces, starts, strict=False)]).astype(
            np.int32
        ),
        colours=np.concatenate(filled) if known else None,
    )


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
    """Read a file of MESH_SUFFIXES, each textured part on its own.

    Materials are reduced to their base colour; transparency is ignored. Materials, textures and buffers beside a file
    are read from its own folder or below, nothing from a network.

    Raises:
        FileError: as read_any_mesh.
    """
    if path.suffix.lower() == ".ply":
        return (MeshPiece(mesh=read_mesh(path)),)
    parts = [part for part in _placed_parts(path) if len(part.faces)]
    if not parts:
        raise FileError(f"{path}: holds no faces. Expected a mesh.")
    return tuple(_piece(path, part, np.zeros(3)) for part in parts)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """A mesh, or points, where the scene puts it."""

    vertices: Float64[np.ndarray, "v 3"]
    faces: Int64[np.ndarray, "t 3"]
    visual: Any
    """Of trimesh; of points, their colours."""


def _placed_parts(path: Path) -> tuple[_Part, ...]:
    """All meshes and points of a scene."""
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise FileError(f"{path}: not a mesh that goc reads. Convert it to one of {', '.join(MESH_SUFFIXES)}.")
    data, total, parts = read_bytes(path, _LIMIT), 0, []
    if suffix == ".obj" and not _OBJ_FACE.search(data):
        return (_obj_points(path, data),)
    import trimesh

    try:
        scene = _scene(path, data)
        for node in scene.graph.nodes_geometry:
            pose, name = scene.graph[node]
            part = scene.geometry[name]
            if not isinstance(part, (trimesh.Trimesh, trimesh.PointCloud)):
                continue
            total += len(part.vertices) + np.size(getattr(part, "faces", ()))
            if total > _MOST_CORNERS:
                raise FileError(f"{path}: its meshes are placed so often that they fill memory. Thin the scene out.")
            parts.append(_placed(part, np.asarray(pose, np.float64)))
    except FileError:
        raise
    except Exception as error:  # trimesh raises whatever its parsers and numpy do
        raise FileError(
            f"{path}: not a readable {suffix[1:].upper()} file ({brief(error)}). Write it again."
        ) from error
    if not parts:
        raise FileError(f"{path}: holds no faces. Expected a mesh.")
    return tuple(parts)


def _obj_points(path: Path, data: bytes) -> _Part:
    """The points of an OBJ without faces: `v x y z`, and r g b from 0 to 1 if there are any."""
    rows = [line.split()[1:] for line in data.splitlines() if line.startswith((b"v ", b"v\t"))]
    try:
        table = np.array(rows, np.float64).reshape(len(rows), -1)
    except ValueError as error:
        raise FileError(f"{path}: its vertices are no numbers in equal rows. Write it again.") from error
    if not len(rows) or table.shape[1] not in (3, 4, 6, 7):
        raise FileError(f"{path}: holds no faces, and no points either. Write it again.")
    colours = table[:, -3:] if table.shape[1] > 4 else None
    return _Part(vertices=table[:, :3], faces=_NO_FACES, visual=colours)


def _points(path: Path, parts: Sequence[_Part]) -> RawPoints:
    colours = [part.visual for part in parts]
    if not sum(len(part.vertices) for part in parts):
        raise FileError(f"{path}: holds no points and no faces. Write the file again.")
    return RawPoints(
        positions=np.concatenate([part.vertices for part in parts]),
        colours=None if any(each is None for each in colours) else np.concatenate(colours),
    )


def _scene(path: Path, data: bytes) -> "Scene":
    """What trimesh makes of a file; glTF is rewritten first, so that nothing in it is left out.

    Raises:
        FileError: glTF that is damaged, or needs what is not read.
    """
    import trimesh
    from trimesh.resolvers import FilePathResolver

    kind, resolver = path.suffix.lower()[1:], FilePathResolver(str(path))
    if kind in ("glb", "gltf"):
        data, kind, resolver = _plain(path, data), "glb", None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=resolver, process=False)


def _plain(path: Path, data: bytes) -> bytes:
    kind = path.suffix.upper()[1:]
    try:
        return plain_glb(path, data)
    except GltfError as error:
        text = str(error)
        if text.endswith("."):
            raise FileError(f"{path}: {text}") from error
        raise FileError(f"{path}: not a readable {kind} file ({brief(error)}). Write it again.") from error
    except FileError:
        raise
    except Exception as error:  # entries of other types than the standard's
        raise FileError(f"{path}: not a readable {kind} file ({brief(error)}). Write it again.") from error


def _placed(part: "Trimesh | PointCloud", pose: Float[np.ndarray, "4 4"]) -> _Part:
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = np.asarray(part.vertices, np.float64) @ pose[:3, :3].T + pose[:3, 3]
        mirrored = np.linalg.det(pose[:3, :3]) < 0
    if not hasattr(part, "faces"):
        colours = np.asarray(getattr(part, "colors", ()))
        known = colours.shape[:1] == vertices.shape[:1] and colours.ndim == 2
        return _Part(vertices=vertices, faces=_NO_FACES, visual=colours[:, :3].astype(np.uint8) if known else None)
    faces = np.asarray(part.faces, np.int64).reshape(-1, 3)
    return _Part(vertices=vertices, faces=faces[:, ::-1] if mirrored else faces, visual=part.visual)


def _piece(path: Path, part: _Part, offset: Float64[np.ndarray, "3"]) -> MeshPiece:
    """One part, its origin moved to `offset`."""
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = (part.vertices - offset).astype(np.float32)
    faces = part.faces.astype(np.int32)
    check_mesh(path, vertices, faces)
    match part.visual.kind:
        case "texture":
            return _textured(path, vertices, faces, part.visual)
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


def _textured(path: Path, vertices: np.ndarray, faces: np.ndarray, visual: Any) -> MeshPiece:
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
    texture = _pixels(path, image)
    if is_gltf and (light != 1).any():  # of an OBJ, the texture stands in the colour's place
        for channel, share in enumerate(light):
            texture[..., channel] = encode_srgb(_LINEAR * share)[texture[..., channel]]
    return MeshPiece(mesh=mesh, uv=np.ascontiguousarray(uv[:, :2]), texture=texture)


def _pixels(path: Path, image: "Image") -> UInt8[np.ndarray, "h w 3"]:
    """A texture, scaled down where it is larger than anything sees; checked before it is decoded."""
    if image.format is not None and image.format not in _TEXTURES:
        raise FileError(f"{path}: its texture is {image.format}, not one of {', '.join(_TEXTURES)}. Convert it.")
    if image.width * image.height > MAX_PIXELS:
        size = f"{image.width} x {image.height}"
        raise FileError(f"{path}: its texture has {size} pixels, more than {MAX_PIXELS // 10**6} million. Scale it.")
    times = -(-max(image.size) // _WIDEST_TEXTURE)
    return np.array((image if times == 1 else image.convert("RGB").reduce(times)).convert("RGB"))


def _vertex_colours(piece: MeshPiece) -> UInt8[np.ndarray, "v 3"] | None:
    if piece.texture is None or piece.uv is None:
        return piece.mesh.colours
    return encode_srgb(sample_texture(piece.texture, piece.uv))
