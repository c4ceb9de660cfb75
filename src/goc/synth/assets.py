"""Turns a folder of meshes into assets for a room: finds, reads, orients and sorts them by where they can stand."""

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull, QhullError

from goc.errors import ConfigError, FileError
from goc.events import Listener, Warned
from goc.files import MESH_SUFFIXES, is_file, is_folder, read_bytes
from goc.files.any_mesh import MeshPiece, read_mesh_pieces
from goc.geometry.raycast import TriangleScene
from goc.settings import Positive, Settings
from goc.synth.model import Model, ModelPart
from goc.synth.scanned_materials import material_of
from goc.synth.shapes import PartMesh
from goc.synth.tops import find_tops
from goc.synth.vectors import length, unit

_CATALOGUE = "objects.csv"
_CATALOGUE_LIMIT = 64 << 20
_LARGE_M = 0.55
"""Objects whose longest side is at least this stand on the floor."""
_SMALL_M = 0.45
"""Objects whose longest side is at most this may stand on others."""
_TALLEST_M = 2.1
_SLENDER = 6.0
"""Ratio of height to least width of the base above which an object would topple."""
_SIDE_RAYS = 12


@dataclass(frozen=True, kw_only=True)
class MeshFolder(Settings):
    """Which meshes of a folder (.glb, .obj, .ply, searched recursively) become things in a room."""

    meshes: Path | None = None
    """Furnish the room with the meshes of this folder and its folders; the settings below are for them."""
    split: str | None = None
    """Only those that objects.csv, in the folder or above it, gives this split."""
    up: Literal["y", "z"] = "z"
    """The files' upward axis: y in most GLB files."""
    scale: Positive = 1.0
    """Metres in one unit of the files."""
    min_m: Positive = 0.06
    """Things whose longest side is shorter are left out."""
    max_m: Positive = 2.6
    """Things whose longest side is longer are left out."""

    def __post_init__(self) -> None:
        """Refuse settings for meshes without meshes."""
        super().__post_init__()
        if self.meshes is None and any(getattr(self, item.name) != item.default for item in fields(self)):
            raise ConfigError(
                "{split}, {up}, {scale}, {min_m}, {max_m} are for meshes. Add {meshes} FOLDER.", type(self)
            )
        if self.min_m >= self.max_m:
            raise ConfigError(f"{{min_m}} is {self.min_m:g}: needs less than {{max_m}} ({self.max_m:g}).", type(self))

    @property
    def folder(self) -> Path:
        """Where the meshes are; only where there are any."""
        assert self.meshes is not None
        return self.meshes


@dataclass(frozen=True, kw_only=True, eq=False)
class Asset:
    """An object that can stand in a room."""

    model: Model
    """Base on z = 0, centred on x = y = 0, back towards +y; tops where things can stand on it."""
    has_back: bool
    """It is higher at the back than in front, as chairs are."""

    @cached_property
    def size(self) -> Float[np.ndarray, "3"]:
        """Width, depth, height."""
        low, high = self.model.bounds
        return high - low

    @property
    def is_large(self) -> bool:
        """It belongs on the floor."""
        return bool(self.size.max() >= _LARGE_M)

    @property
    def is_small(self) -> bool:
        """It may stand on other things."""
        return bool(self.size.max() <= _SMALL_M)

    @property
    def is_support(self) -> bool:
        """Things can stand on it, at knee height or above."""
        return self.is_large and any(top.width * top.depth >= 0.1 and top.z >= 0.25 for top in self.model.tops)


def list_meshes(source: MeshFolder) -> tuple[tuple[Path, str], ...]:
    """Paths of all meshes that are asked for, with their names, in alphabetical order.

    Raises:
        FileError: the folder is missing or holds no mesh, or objects.csv lacks columns.
        ConfigError: a split is asked for that there is not.
    """
    root = source.folder
    if not is_folder(root):
        raise FileError(f"{root}: not a folder. Give one with .glb, .obj or .ply meshes.")
    found = sorted(path for path in root.rglob("*") if path.suffix.lower() in MESH_SUFFIXES and path.is_file())
    if not found:
        raise FileError(f"{root}: holds no meshes. Looked for {', '.join(MESH_SUFFIXES)}, also in its folders.")
    catalogue = _catalogue(root)
    if source.split is None:
        return tuple((path, catalogue.get(path, (path.stem, ""))[0]) for path in found)
    splits = sorted({split for _, split in catalogue.values()})
    chosen = tuple((path, catalogue[path][0]) for path in found if catalogue.get(path, ("", ""))[1] == source.split)
    if not chosen:
        known = f"it knows {', '.join(splits)}" if splits else "there is none"
        raise ConfigError(f"--split {source.split}: no mesh of {root} is in that split of {_CATALOGUE} ({known}).")
    return chosen


def _catalogue(root: Path) -> dict[Path, tuple[str, str]]:
    """Name and split of each mesh, from objects.csv in the folder or one of three above it; empty if there is none."""
    where = next((folder for folder in (root, *root.resolve().parents[:3]) if is_file(folder / _CATALOGUE)), None)
    if where is None:
        return {}
    text = read_bytes(where / _CATALOGUE, _CATALOGUE_LIMIT).decode("utf-8", "replace")
    rows = csv.DictReader(io.StringIO(text))
    lacking = [name for name in ("file", "name", "split") if name not in (rows.fieldnames or [])]
    if lacking:
        raise FileError(f"{where / _CATALOGUE}: has no column {lacking[0]}. Add it, or remove the file.")
    entries = {str((where / row["file"]).resolve()): (row["name"], row["split"]) for row in rows if row["file"]}
    paths = {path: str(path.resolve()) for path in root.rglob("*")}
    return {path: entries[full] for path, full in paths.items() if full in entries}


def draw_assets(source: MeshFolder, rng: np.random.Generator, notify: Listener) -> Iterator[Asset]:
    """Yield assets in random order, reading each file when its turn comes; damaged and unsuitable ones are skipped.

    When the iteration ends, a warning says how many were damaged and how many unsuitable, and names the first of each.
    """
    meshes = list_meshes(source)
    damaged: list[str] = []
    unsuitable: list[str] = []
    tried = 0
    try:
        for index in rng.permutation(len(meshes)):
            path, name = meshes[index]
            tried += 1
            try:
                asset = make_asset(read_mesh_pieces(path), name, source)
            except FileError as error:
                damaged.append(str(error))
            except _Unsuitable as reason:
                unsuitable.append(f"{path.name}: {reason}")
            else:
                yield asset
    finally:
        for kind, culprits in (("damaged", damaged), ("unsuitable", unsuitable)):
            if culprits:
                message = f"{len(culprits)} of {tried} meshes tried are {kind} and left out (first: {culprits[0]})"
                notify(Warned(stage="synth", message=message))


class _Unsuitable(ValueError):
    """The reason why a mesh cannot stand in a room."""


def make_asset(pieces: tuple[MeshPiece, ...], name: str, source: MeshFolder) -> Asset:
    """Stand a mesh upright, turn its back to +y, turn its faces outwards, find its tops.

    Raises:
        _Unsuitable: too small, too large, or it would topple.
    """
    vertices = [_upright(piece.mesh.vertices, source) for piece in pieces]
    everything = np.concatenate(vertices)
    low, high = everything.min(0), everything.max(0)
    _check_size(high - low, source)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    everything = everything - origin
    starts = np.cumsum([0] + [len(each) for each in vertices])
    faces = [piece.mesh.faces + start for piece, start in zip(pieces, starts, strict=False)]
    _check_stands(everything, np.concatenate(faces))
    turn, has_back = _turn(everything)
    vertices = [(each - origin) @ turn.T for each in vertices]
    outward = outward_faces(np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.int32))
    counts = np.cumsum([len(each) for each in faces])[:-1]
    parts = []
    for piece, place, own, start in zip(pieces, vertices, np.split(outward, counts), starts, strict=False):
        material, texture = material_of(piece)
        mesh = PartMesh(vertices=place, faces=own - start)
        parts.append(ModelPart(mesh=mesh, material=material, texture=texture, scanned=True))
    scene = TriangleScene(np.concatenate(vertices).astype(np.float32), outward)
    return Asset(model=Model(name=name, parts=tuple(parts), tops=find_tops(scene)), has_back=has_back)


def _upright(vertices: np.ndarray, source: MeshFolder) -> Float[np.ndarray, "v 3"]:
    metres = vertices.astype(np.float64) * source.scale
    return metres if source.up == "z" else metres[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0])


def _check_size(size: Float[np.ndarray, "3"], source: MeshFolder) -> None:
    longest = float(size.max())
    if longest < source.min_m:
        raise _Unsuitable(f"{longest:.3g} m long, less than --min-m {source.min_m:g}; see --scale")
    if longest > source.max_m:
        raise _Unsuitable(f"{longest:.3g} m long, more than --max-m {source.max_m:g}; see --scale")
    if size[2] > _TALLEST_M:
        raise _Unsuitable(f"{size[2]:.2f} m high, does not fit under the lamp; see --up")
    if size.min() < 0.004:
        raise _Unsuitable("flat: no side view would show it")


def _check_stands(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "t 3"]) -> None:
    """The middle of the surface must lie over the base, and the base be wide enough for the height."""
    height = float(vertices[:, 2].max())
    base = vertices[vertices[:, 2] <= max(0.005, 0.1 * height)][:, :2]
    try:
        hull = ConvexHull(base)
    except (QhullError, ValueError) as error:
        raise _Unsuitable("stands on an edge or a point; see --up") from error
    corners = vertices[faces]
    areas = length(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    middle = (areas @ corners.mean(1) / max(float(areas.sum()), 1e-12))[:2]
    distances = -(hull.equations[:, :2] @ middle + hull.equations[:, 2])  # to each side of the base
    outline = base[hull.vertices]
    width = min(float(np.ptp(outline @ side)) for side in hull.equations[:, :2])
    if distances.min() < 0 or height > _SLENDER * max(width, 1e-9):
        raise _Unsuitable("would topple as it stands; see --up")


def _turn(vertices: Float[np.ndarray, "v 3"]) -> tuple[Float[np.ndarray, "3 3"], bool]:
    """The rotation that brings the back to +y, and whether there is a back.

    The back is the side towards which the uppermost sixth leans by more than a tenth of the extent; without one, a
    long side is as good.
    """
    size = np.ptp(vertices, axis=0)
    upper = vertices[vertices[:, 2] > 0.83 * size[2]]
    lean = (upper[:, :2].min(0) + upper[:, :2].max(0)) / 2 / size[:2]
    axis = int(np.abs(lean).argmax())
    has_back = bool(abs(lean[axis]) > 0.1)
    if has_back:
        quarter = (0 if lean[1] > 0 else 2) if axis == 1 else (1 if lean[0] > 0 else 3)
    else:
        quarter = 0 if size[0] >= size[1] else 1
    cosine, sine = [(1, 0), (0, 1), (-1, 0), (0, -1)][quarter]
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]), has_back


def outward_faces(vertices: np.ndarray, faces: np.ndarray) -> Int[np.ndarray, "t 3"]:
    """Turn faces so that their front is the side from which more of the outside is seen.

    From a hair above and below each face, twelve rays go out on either side; those that hit nothing of the mesh count.
    A face is turned only where its back clearly wins, so that sheets which are open on both sides stay as they are.
    """
    scene = TriangleScene(vertices, faces)
    corners = vertices[faces].astype(np.float64)
    normals = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    middle, reach = corners.mean(1), float(np.ptp(vertices, axis=0).max())
    free = [np.zeros(len(faces), int), np.zeros(len(faces), int)]
    index = np.arange(_SIDE_RAYS) + 0.5
    height, angle = 1 - 2 * index / _SIDE_RAYS, np.pi * (1 + 5**0.5) * index
    ring = np.sqrt(1 - height**2)
    for direction in np.stack([ring * np.cos(angle), ring * np.sin(angle), height], -1):
        for side, sign in enumerate((1.0, -1.0)):
            facing = sign * np.where((normals @ direction) >= 0, 1.0, -1.0)
            rays = facing[:, None] * direction
            blocked = scene.occluded(middle + sign * 1e-5 * reach * normals, rays, 4 * reach)
            free[side] += ~blocked
    turned = free[1] >= 2 * free[0] + 3
    return np.where(turned[:, None], faces[:, ::-1], faces).astype(np.int32)
