"""Meshes and point clouds as PLY, checked so that native code may trust the arrays."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Shaped, UInt8

from goc.errors import FileError
from goc.files.offsets import recentred
from goc.files.ply import Column, Lists, read_ply, write_ply
from goc.files.raw_points import as_bytes
from goc.scene import Mesh, PointCloud

_FACES = ("vertex_indices", "vertex_index")
_RGB = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
_NO_COLOUR = 128  # mid grey, sRGB


def write_mesh(
    path: Path,
    mesh: Mesh,
    observed: Bool[np.ndarray, "v"] | None = None,
    offset: Float64[np.ndarray, "3"] | None = None,
) -> None:
    """Write a mesh as binary PLY, atomically.

    Args:
        path: ends in .ply.
        mesh: metres, world.
        observed: per vertex, whether some camera measured this surface; becomes a uchar property of that name.
        offset: added to the positions, which then are written in double precision.

    Raises:
        FileError: an index out of range or a position that is not finite (nothing is written), or the disk refuses.
    """
    check_mesh(path, mesh.vertices, mesh.faces)
    far = offset is not None and offset.any()
    vertex = _xyz(mesh.vertices.astype(np.float64) + offset if far else mesh.vertices) | _rgb(mesh.colours)
    if observed is not None:
        vertex["observed"] = observed.astype(np.uint8)
    write_ply(path, {"vertex": vertex, "face": {"vertex_indices": mesh.faces}})


def read_mesh(path: Path) -> Mesh:
    """Read a triangle mesh; polygons become fans round their first corner, which is right for convex ones.

    Raises:
        FileError: missing, malformed, without vertices or faces, indices out of range, or positions not finite.
    """
    return _mesh(path, read_ply(path))


def read_observed_mesh(path: Path) -> tuple[Mesh, Bool[np.ndarray, "v"]]:
    """Read a mesh and the `observed` flag of each vertex, as `write_mesh` wrote them.

    Raises:
        FileError: as `read_mesh`, or the flag is not there.
    """
    elements = read_ply(path)
    mesh = _mesh(path, elements)
    observed = elements["vertex"].get("observed")
    if not isinstance(observed, np.ndarray):
        raise FileError(f"{path}: its vertices have no property observed. Export the object again with goc.")
    return mesh, observed != 0


def write_points(path: Path, points: PointCloud) -> None:
    """Write a point cloud as binary PLY, atomically."""
    _check_finite(path, points.positions)
    vertex = _xyz(points.positions) | _rgb(points.colours)
    if points.normals is not None:
        vertex |= {name: points.normals[:, i] for i, name in enumerate(("nx", "ny", "nz"))}
    write_ply(path, {"vertex": vertex})


def read_points(path: Path) -> PointCloud:
    """Read the vertices of a PLY file: x y z, colours (mid grey if there are none), normals if there are any.

    Raises:
        FileError: missing, malformed, without points, or with positions or normals that are not finite.
    """
    vertex = _vertices(path, read_ply(path))
    positions = _triple(path, vertex, ("x", "y", "z"))
    _check_finite(path, positions)
    normals = _triple(path, vertex, ("nx", "ny", "nz")) if "nx" in vertex else None
    if normals is not None:
        _check_finite(path, normals)
    colours = _colours(path, vertex)
    if colours is None:
        colours = np.full((len(positions), 3), _NO_COLOUR, np.uint8)
    return PointCloud(positions=positions, colours=colours, normals=normals)


def raw_vertices(
    path: Path, elements: dict[str, dict[str, Column]]
) -> tuple[Float[np.ndarray, "v 3"], Shaped[np.ndarray, "v 3"] | None, Float[np.ndarray, "v 3"] | None]:
    """Positions of the vertices of a PLY file in its own precision, their colours and their normals, if there are any.

    Raises:
        FileError: there are no vertices, or one of three columns is missing.
    """
    vertex = _vertices(path, elements)
    normals = _stored(path, vertex, ("nx", "ny", "nz")).astype(np.float32) if "nx" in vertex else None
    return _stored(path, vertex, ("x", "y", "z")), _colours(path, vertex), normals


def placed_mesh(path: Path, elements: dict[str, dict[str, Column]]) -> tuple[Mesh, Float64[np.ndarray, "3"]]:
    """The mesh of a PLY file about an origin that single precision can bear, and where that lies in the file's frame.

    Raises:
        FileError: as `read_mesh`.
    """
    positions = _stored(path, _vertices(path, elements), ("x", "y", "z"))
    _check_finite(path, positions)
    vertices, offset = recentred(path, positions)
    return _mesh(path, elements, vertices), offset


def _mesh(
    path: Path, elements: dict[str, dict[str, Column]], vertices: Float32[np.ndarray, "v 3"] | None = None
) -> Mesh:
    vertex = _vertices(path, elements)
    vertices = _triple(path, vertex, ("x", "y", "z")) if vertices is None else vertices
    columns = elements.get("face", {})
    polygons = next((columns[name] for name in _FACES if name in columns), None)
    if not isinstance(polygons, Lists) or not len(polygons.counts) or polygons.values.dtype.kind == "f":
        raise FileError(f"{path}: holds no faces. Expected a mesh; for a point cloud there is nothing to do here.")
    if polygons.counts.min() < 3:
        bad = polygons.counts < 3
        first = int(np.flatnonzero(bad)[0])
        raise FileError(
            f"{path}: {bad.sum()} faces have fewer than three corners (first: face {first}). Repair the mesh."
        )
    corners = polygons.values.astype(np.int64)
    _check_indices(path, corners, len(vertices))
    _check_finite(path, vertices)
    return Mesh(vertices=vertices, faces=_fans(polygons.counts, corners), colours=_colours(path, vertex))


def _fans(counts: np.ndarray, corners: np.ndarray) -> Int32[np.ndarray, "t 3"]:
    """Triangles (first, i, i + 1) of each polygon."""
    if (counts == 3).all():
        return corners.reshape(-1, 3).astype(np.int32)
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    triangles = counts - 2
    first = np.repeat(starts, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([corners[first], corners[first + step + 1], corners[first + step + 2]], 1).astype(np.int32)


def _vertices(path: Path, elements: dict[str, dict[str, Column]]) -> dict[str, Column]:
    vertex = elements.get("vertex", {})
    missing = [name for name in ("x", "y", "z") if not isinstance(vertex.get(name), np.ndarray)]
    if missing:
        raise FileError(f"{path}: its vertices lack {', '.join(missing)}. Write the file again.")
    if not len(vertex["x"]):
        raise FileError(f"{path}: holds no vertices. Write the file again.")
    return vertex


def _triple(path: Path, vertex: dict[str, Column], names: tuple[str, str, str]) -> Float32[np.ndarray, "v 3"]:
    with np.errstate(over="ignore"):  # doubles beyond float32 become infinite and are refused as such
        return _stored(path, vertex, names).astype(np.float32)


def _stored(path: Path, vertex: dict[str, Column], names: tuple[str, str, str]) -> Float[np.ndarray, "v 3"]:
    """Three columns in the precision of the file, as single precision at least."""
    columns = [vertex.get(name) for name in names]
    if not all(isinstance(column, np.ndarray) for column in columns):
        raise FileError(f"{path}: expected the vertex properties {' '.join(names)} together. Write the file again.")
    table = np.stack([np.asarray(column) for column in columns], 1)
    return table if table.dtype in (np.float32, np.float64) else table.astype(np.float64)


def _colours(path: Path, vertex: dict[str, Column]) -> UInt8[np.ndarray, "v 3"] | None:
    names = next((names for names in _RGB if names[0] in vertex), None)
    if names is None:
        return None
    columns = [vertex.get(name) for name in names]
    if not all(isinstance(column, np.ndarray) for column in columns):
        raise FileError(f"{path}: expected {', '.join(names)} together, a number each. Write the colours again.")
    return as_bytes(np.stack([np.asarray(column) for column in columns], 1), len(np.asarray(columns[0])))


def _xyz(positions: Float[np.ndarray, "v 3"]) -> dict[str, np.ndarray]:
    return {name: positions[:, i] for i, name in enumerate("xyz")}


def _rgb(colours: UInt8[np.ndarray, "v 3"] | None) -> dict[str, np.ndarray]:
    return {} if colours is None else {name: colours[:, i] for i, name in enumerate(("red", "green", "blue"))}


def check_mesh(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse (FileError) positions that are not finite and faces that name vertices that are not there."""
    _check_finite(path, vertices)
    _check_indices(path, faces.reshape(-1), len(vertices))


def _check_finite(path: Path, positions: np.ndarray) -> None:
    bad = ~np.isfinite(positions).all(1)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise FileError(f"{path}: {bad.sum()} of {len(bad)} vertices are not finite (first: {first}). Repair the data.")


def _check_indices(path: Path, corners: np.ndarray, count: int) -> None:
    bad = (corners < 0) | (corners >= count)
    if bad.any():
        first = int(corners[bad][0])
        raise FileError(
            f"{path}: {bad.sum()} corners name a vertex that is not there (first: {first} of {count}). Repair it."
        )
