"""Reader of the two packs in which renderings of the Replica rooms (Straub et al. 2019) are passed on.

NICE-SLAM     results/frame000000.jpg  results/depth000000.png  traj.txt            depth 6553.5 steps a metre
vMAP and      rgb/rgb_0.png  depth/depth_0.png  traj_w_c.txt                        millimetres
Semantic-NeRF semantic_instance/semantic_instance_0.png  semantic_class/…           16 bits

Trajectories have one camera-to-world matrix a line, OpenCV axes. cam_params.json beside the folder or in it gives the
intrinsics; without it they are those that the packs were rendered with: 90° across, the principal point in the middle.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float64

from goc.capture.config import CaptureConfig
from goc.capture.pixels import path_of
from goc.capture.readers.labels import classes_of, table_of
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, COLOUR, demand, first_with, numbered, posed, thinned, warn
from goc.capture.source import IdCodes, Lens, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import MILLIMETRES, image_size, is_file, is_folder, read_json, read_matrix

_TRAJECTORY_LIMIT = 256 << 20
_MOST_IDS = 4096
# Classes of Replica that vMAP takes for the room: ceiling, door, floor, wall, window, and what lies flat upon them.
_ROOM_CLASSES = frozenset({5, 12, 30, 31, 40, 60, 92, 93, 95, 97, 98, 79})


class _Camera(msgspec.Struct):
    w: int
    h: int
    fx: float
    fy: float
    cx: float
    cy: float
    scale: float


class _Parameters(msgspec.Struct):
    camera: _Camera


class _Named(msgspec.Struct):
    id: int
    name: str = ""
    class_name: str = ""


class _Semantics(msgspec.Struct):
    objects: list[_Named] = []


@dataclass(frozen=True)
class _Pack:
    name: str
    trajectory: str
    colour: str
    depth: str
    colour_stem: str
    depth_stem: str
    steps_per_metre: float


_PACKS = (
    _Pack("Replica (NICE-SLAM)", "traj.txt", "results", "results", r"frame(\d+)", r"depth(\d+)", 6553.5),
    _Pack("Replica (vMAP)", "traj_w_c.txt", "rgb", "depth", r"rgb_(\d+)", r"depth_(\d+)", MILLIMETRES),
)


def detect(path: Path) -> bool:
    """Whether `path` is a folder of one of the packs: a trajectory, and images that have its names."""
    return _pack(path) is not None


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a pack.

    Raises:
        FileError: a file is malformed.
        CaptureError: a part is missing, the trajectory is shorter than the images, or a pose is not rigid.
    """
    pack = _pack(path) or _PACKS[0]
    images = numbered(path / pack.colour, COLOUR, pack.colour_stem)
    trajectory = path / pack.trajectory
    demand(path, pack.name, [(pack.trajectory, is_file(trajectory)), (f"images in {pack.colour}/", bool(images))])
    poses = _trajectory(trajectory, images)
    lens, steps = _lens(path, pack, next(iter(images.values())))
    depth = numbered(path / pack.depth, (".png",), pack.depth_stem)
    ids = numbered(path / "semantic_instance", (".png",)) if config.use_ids else {}
    views = [
        View(
            name=f"{pack.colour}/{images[number].name}",
            lens=lens,
            world_from_cam=poses[number],
            image=images[number],
            depth=depth.get(number) if depth else None,
            ids=ids.get(number),
        )
        for number in thinned(list(images), config, notify)
    ]
    views = posed(trajectory, views, notify)
    source = Source(path=path, views=views, depth_units_per_metre=steps, metric=True, up=(0.0, 0.0, 1.0))
    return _labelled(source, path, notify) if ids else source


def _pack(path: Path) -> _Pack | None:
    """The pack of which a folder has the images, or the trajectory and the folder that the images belong into."""
    for pack in _PACKS:
        if is_file(path / pack.trajectory) and is_folder(path / pack.colour):
            return pack
        # semantic_instance/ alone tells vMAP's pack from other folders of rgb/
        if pack.colour == "rgb" and is_folder(path / "rgb") and is_folder(path / "semantic_instance"):
            return pack
        if pack.colour == "results" and numbered(path / "results", COLOUR, pack.colour_stem):
            return pack
    return None


def _trajectory(path: Path, images: dict[int, Path]) -> Float64[np.ndarray, "lines 4 4"]:
    rows = read_matrix(path, finite=False, limit=_TRAJECTORY_LIMIT)
    if rows.shape[1] != 16:
        raise CaptureError(f"{path}: {rows.shape[1]} numbers a line, not the 16 of a 4 x 4 matrix. Copy it again.")
    last = max(images)
    if last >= len(rows):
        text = f"{path}: {len(rows)} poses, but images up to number {last} (first: {images[last].name})"
        raise CaptureError(f"{text}. Copy the capture again; image n has pose n.")
    return rows.reshape(-1, 4, 4)


def _lens(path: Path, pack: _Pack, image: Path) -> tuple[Lens, float]:
    """Intrinsics, and depth steps in a metre."""
    width, height = image_size(image)
    stated = first_with(path, ["cam_params.json"])
    if stated is None:
        focal = width / 2  # 90 degrees across
        return Lens(width, height, (focal, focal), (width / 2, height / 2)), pack.steps_per_metre
    given = read_json(stated, _Parameters).camera
    if not (given.fx > 0 and given.fy > 0 and given.scale > 0 and given.w > 0 and given.h > 0):
        raise CaptureError(f"{stated}: w, h, fx, fy and scale must be positive. Download it again.")
    lens = Lens(given.w, given.h, (given.fx, given.fy), (given.cx + CENTRE, given.cy + CENTRE))
    return lens, given.scale


def _labelled(source: Source, path: Path, notify: Listener) -> Source:
    """Tell the instances of the room from things, by the class images and info_semantic.json."""
    classes = numbered(path / "semantic_class", (".png",))
    stated = first_with(path, ["info_semantic.json", "habitat/info_semantic.json"])
    objects = read_json(stated, _Semantics).objects if stated else []
    numbers = [(view.ids, _number(path_of(view.ids))) for view in source.views if view.ids]
    pairs = [(ids, classes[number]) for ids, number in numbers if number in classes]
    kinds = classes_of(pairs)
    rooms = {instance for instance, kind in kinds.items() if kind in _ROOM_CLASSES}
    if not classes:
        warn(notify, "no semantic_class/ tells walls and floor from things: each instance is an object")
    names = {thing.id: thing.class_name or thing.name for thing in objects if 0 < thing.id <= _MOST_IDS}
    names = {number: name for number, name in names.items() if name and number not in rooms}
    codes = IdCodes(table=table_of(rooms, absent=None if 0 in rooms else 0, most=_MOST_IDS))
    return replace(source, id_codes=codes, id_names=names)


def _number(file: Path) -> int:
    return int(file.stem.rpartition("_")[2])


READER = Reader(
    name="Replica",
    expects="results/ and traj.txt, or rgb/ and traj_w_c.txt (Replica)",
    detect=detect,
    read=read,
)
