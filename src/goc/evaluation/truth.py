"""The ground truth of a room: samples of its surfaces, what was seen of them, and the complete meshes."""

import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64, Int64
from scipy.spatial import cKDTree

from goc.errors import FileError
from goc.evaluation.metrics import SurfaceSamples
from goc.files import is_file, read_json, read_mesh
from goc.scene import ROOM, Mesh

SEEN_WITHIN = 0.015
"""A true surface point counts as seen where a sample of what the views saw lies this near, metres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueObject:
    """One object's outer skin."""

    samples: SurfaceSamples
    seen: Bool[np.ndarray, "p"]
    """Which samples some view saw."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """A capture's gt/ folder: samples in memory, meshes read when asked for."""

    folder: Path
    """The capture: holds gt/."""
    objects: dict[int, TrueObject]
    seen: SurfaceSamples
    """Samples of everything that some view saw, the room included."""
    seen_ids: Int64[np.ndarray, "s"]
    labels: dict[int, str]

    def label(self, id: int) -> str:
        """What a true object is called."""
        return self.labels.get(id, f"object {id}")

    def mesh(self, id: int) -> Mesh:
        """The complete mesh of an object, or of the room (0), world, metres.

        Raises:
            FileError: it is missing or malformed.
        """
        return read_mesh(self.folder / "gt" / ("room.ply" if id == ROOM else f"objects/{id}.ply"))


def read_truth(capture: Path) -> Truth:
    """Read the samples of `capture`/gt/points.npz and the names in labels.json.

    Args:
        capture: The folder that holds gt/, or a transforms file in it.

    Raises:
        FileError: the ground truth is missing, malformed, or lacks an array.
    """
    folder = capture.parent if is_file(capture) else capture
    arrays = _read_arrays(folder / "gt" / "points.npz")
    ids = sorted(int(name[1:]) for name in arrays if name.startswith("p"))
    seen = arrays["seen"].astype(np.float64)
    seen_ids = seen[:, 6].astype(np.int64)
    objects = {
        id: TrueObject(
            samples=SurfaceSamples(
                points=arrays[f"p{id}"].astype(np.float64), normals=arrays[f"n{id}"].astype(np.float64)
            ),
            seen=_near(arrays[f"p{id}"].astype(np.float64), seen[seen_ids == id, :3]),
        )
        for id in ids
    }
    names = folder / "labels.json"
    labels = read_json(names, dict[int, str]) if is_file(names) else {}
    return Truth(
        folder=folder,
        objects=objects,
        seen=SurfaceSamples(points=seen[:, :3], normals=seen[:, 3:6]),
        seen_ids=seen_ids,
        labels=labels,
    )


def _near(points: Float64[np.ndarray, "p 3"], samples: Float64[np.ndarray, "s 3"]) -> Bool[np.ndarray, "p"]:
    if len(samples) == 0:
        return np.zeros(len(points), bool)
    return cKDTree(samples).query(points, distance_upper_bound=SEEN_WITHIN)[0] <= SEEN_WITHIN


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        # Opened here: NumPy forgets to close a file that turns out to be no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: cannot be read ({error}). A benchmark room keeps its ground truth there.") from error
    ids = [name[1:] for name in arrays if name.startswith("p")]
    lacking = [name for name in ["seen", *(f"n{id}" for id in ids)] if name not in arrays]
    if lacking or not ids:
        first = lacking[0] if lacking else "p1"
        raise FileError(f"{path}: {max(1, len(lacking))} arrays are missing (first: {first}). Copy the room again.")
    _check_arrays(path, arrays)
    return arrays


def _check_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    for name, array in arrays.items():
        width = 7 if name == "seen" else 3
        number = name[:1] in "pn" and name[1:].isdigit() and int(name[1:]) > 0
        if name != "seen" and not number:
            raise FileError(f"{path}: array {name!r} is none of p<id>, n<id>, seen. Copy the room again.")
        if array.ndim != 2 or array.shape[1] != width or array.dtype.kind != "f" or not len(array):
            shape = f"{array.shape} {array.dtype}"
            raise FileError(f"{path}: array {name} is {shape}, expected rows of {width} floats. Copy the room again.")
        if not np.isfinite(array).all():
            raise FileError(f"{path}: array {name} holds numbers that are not finite. Copy the room again.")
