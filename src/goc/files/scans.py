"""Partial scans, whatever they come as: a mesh, or points with or without normals."""

from pathlib import Path

import numpy as np

from goc.errors import FileError
from goc.files.any_mesh import MESH_SUFFIXES, read_mesh_or_points
from goc.files.e57 import read_e57
from goc.files.las import read_las
from goc.files.meshes import placed_mesh, raw_vertices
from goc.files.pcd import read_pcd
from goc.files.ply import Column, read_ply
from goc.files.raw_points import RawPoints, Scan, placed, scan_of
from goc.files.text_points import read_text_points

_READERS = {
    **dict.fromkeys((".xyz", ".txt", ".pts", ".asc", ".csv"), read_text_points),
    ".pcd": read_pcd,
    ".las": read_las,
    ".laz": read_las,
    ".e57": read_e57,
}
SCAN_SUFFIXES = (*MESH_SUFFIXES, *_READERS)
"""What can be read as a partial scan."""


def read_scan(path: Path) -> Scan:
    """Read a partial scan, in the file's axes and unit.

    A mesh is what has faces (MESH_SUFFIXES); points are what has none, and .pcd, .las, .laz, .e57 and text.
    Points without a finite place, which fill up organised clouds, are left out and counted. Coordinates far from their
    origin, such as those of a national grid, are moved before they become single precision.

    Raises:
        FileError: missing, damaged, of another format, empty, without the digits to tell its points apart, or of a
            format whose extra is not installed.
    """
    suffix = path.suffix.lower()
    if suffix in _READERS:
        return scan_of(path, _READERS[suffix](path))
    if suffix not in MESH_SUFFIXES:
        known = ", ".join(SCAN_SUFFIXES)
        raise FileError(f"{path}: not a scan that goc reads. Convert it to one of {known}.")
    if suffix == ".ply":
        elements = read_ply(path)
        if any(_rows(element) for name, element in elements.items() if name in ("face", "tristrips")):
            mesh, offset = placed_mesh(path, elements)
            return placed(mesh, offset)
        return scan_of(path, _ply_points(path, elements))
    found = read_mesh_or_points(path)
    return scan_of(path, found) if isinstance(found, RawPoints) else placed(*found)


def _rows(element: dict[str, Column]) -> int:
    column = next(iter(element.values()), None)
    if column is None:
        return 0
    return len(column) if isinstance(column, np.ndarray) else len(column.counts)


def _ply_points(path: Path, elements: dict[str, dict[str, Column]]) -> RawPoints:
    """Vertices; PCL writes into the element `camera` where they were seen from."""
    positions, colours, normals = raw_vertices(path, elements)
    camera = elements.get("camera", {})
    place = [camera.get(f"view_p{axis}") for axis in "xyz"]
    seen = None
    if all(isinstance(value, np.ndarray) and len(value) == 1 for value in place):
        seen = np.array([float(value[0]) for value in place if isinstance(value, np.ndarray)])
    return RawPoints(
        positions=positions,
        colours=colours,
        normals=normals,
        seen_from=seen if seen is not None and seen.any() and np.isfinite(seen).all() else None,
    )
