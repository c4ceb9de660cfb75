"""Partial scans, whatever they come as: a mesh, or points with or without normals."""

import io
from pathlib import Path

import numpy as np

from goc.errors import FileError
from goc.files.any_mesh import MESH_SUFFIXES, read_any_mesh
from goc.files.meshes import read_mesh, read_points
from goc.files.pcd import read_pcd
from goc.files.ply import read_ply
from goc.files.reading import brief, read_bytes
from goc.scene import Mesh, PointCloud

_TEXT = (".xyz", ".txt", ".pts")
_LIMIT = 1 << 30
_NO_COLOUR = 128  # mid grey, sRGB


def read_scan(path: Path) -> Mesh | PointCloud:
    """Read a mesh (.ply, .glb, .obj) or points (.ply without faces, .pcd, .xyz, .txt, .pts), in the file's axes.

    Text holds a point a line: x y z, then nothing, a normal (nx ny nz), or a colour (r g b, 0 to 255), or both: colour
    first. `#` starts a comment.

    Raises:
        FileError: missing, damaged, of another format, empty, or with positions that are not finite.
    """
    suffix = path.suffix.lower()
    if suffix in _TEXT:
        return _read_text(path)
    if suffix == ".pcd":
        return read_pcd(path)
    if suffix == ".ply":
        return read_mesh(path) if "face" in read_ply(path) else read_points(path)
    if suffix not in MESH_SUFFIXES:
        known = ", ".join((*MESH_SUFFIXES, ".pcd", *_TEXT))
        raise FileError(f"{path}: not a scan that goc reads. Convert it to one of {known}.")
    return read_any_mesh(path, weld=True)


def _read_text(path: Path) -> PointCloud:
    data = read_bytes(path, _LIMIT)
    if not data.strip():
        raise FileError(f"{path}: holds no points. Write the file again.")
    try:
        rows = np.loadtxt(io.BytesIO(data), ndmin=2, dtype=np.float64, encoding="utf-8")
    except ValueError as error:
        raise FileError(f"{path}: not numbers in equal rows ({brief(error)}). Write x y z, a point a line.") from error
    if rows.shape[1] not in (3, 6, 9) or len(rows) == 0:
        raise FileError(f"{path}: {rows.shape[1]} numbers a line; 3, 6 or 9 are expected (x y z, r g b, nx ny nz).")
    bad = ~np.isfinite(rows).all(axis=1)
    if bad.any():
        first = int(np.flatnonzero(bad)[0])
        raise FileError(f"{path}: {bad.sum()} of {len(bad)} points are not finite (first: {first}). Repair the data.")
    colours, normals = None, rows[:, 6:9] if rows.shape[1] == 9 else None
    if rows.shape[1] == 6 and (np.abs(rows[:, 3:]) <= 1.0 + 1e-3).all():
        normals = rows[:, 3:]
    elif rows.shape[1] > 3:
        colours = np.clip(np.rint(rows[:, 3:6]), 0, 255).astype(np.uint8)
    return PointCloud(
        positions=rows[:, :3].astype(np.float32),
        colours=np.full((len(rows), 3), _NO_COLOUR, np.uint8) if colours is None else colours,
        normals=None if normals is None else normals.astype(np.float32),
    )
