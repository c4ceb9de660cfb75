"""Reader of scenes of the BOP challenge (Hodan et al. 2018).

scene_camera.json    {"0": {cam_K, depth_scale, cam_R_w2c, cam_t_w2c}}    millimetres; the first pixel centred at 0
scene_gt.json        {"0": [{obj_id, cam_R_m2c, cam_t_m2c}]}
rgb/000000.png       or .jpg, or gray/      depth/000000.png    times depth_scale: millimetres
mask_visib/000000_000003.png                the third entry of image 0 in scene_gt.json

Where no image has a pose in the world, that of an object that is in every image once takes its place: such scenes show
things that lie still. Entries of one object that stay in one place in the world are one instance.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from jaxtyping import Float64

from goc.capture.config import CaptureConfig
from goc.capture.pixels import ObjectMasks
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, COLOUR, demand, numbered, paired, posed, thinned, warn
from goc.capture.source import Lens, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import MILLIMETRES, image_size, is_file, is_folder, read_json

_SAME_PLACE_M = 0.05
_FOLDERS = ("rgb", "gray", "rgb_realsense", "rgb_photoneo")


class _Camera(msgspec.Struct):
    cam_K: list[float]  # noqa: N815 - BOP's spelling
    depth_scale: float = 1.0
    cam_R_w2c: list[float] | None = None  # noqa: N815
    cam_t_w2c: list[float] | None = None


class _Entry(msgspec.Struct):
    obj_id: int
    cam_R_m2c: list[float]  # noqa: N815
    cam_t_m2c: list[float]


_Truth = dict[int, list[_Entry]]


@dataclass(frozen=True)
class _Instances:
    """Ids of the entries of each image, and their names."""

    ids: dict[int, list[int]]
    names: dict[int, str]


def detect(path: Path) -> bool:
    """Whether `path` is a folder with scene_camera.json, or scene_gt.json and images."""
    return is_file(path / "scene_camera.json") or (is_file(path / "scene_gt.json") and bool(_images(path)))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a scene.

    Raises:
        FileError: a JSON file is malformed.
        CaptureError: a part is missing, or nothing tells where the cameras stood.
    """
    where, images = path / "scene_camera.json", _images(path)
    demand(path, "BOP", [(where.name, is_file(where)), ("images in rgb/ or gray/", bool(images))])
    cameras = read_json(where, dict[int, _Camera])
    truth = read_json(path / "scene_gt.json", _Truth) if is_file(path / "scene_gt.json") else {}
    numbers = thinned(paired(path, images, cameras, "camera", config, notify), config, notify)
    poses = _poses(where, numbers, cameras, truth, notify)
    found = _instances(numbers, poses, truth) if config.use_ids else _Instances({}, {})
    depth = numbered(path / "depth", (".png",))
    views = [
        View(
            name=str(images[number].relative_to(path)),
            lens=_lens(where, number, cameras[number], images[number]),
            world_from_cam=poses[number],
            image=images[number],
            depth=depth.get(number),
            depth_units_per_metre=MILLIMETRES / cameras[number].depth_scale,
            ids=_masks(path, number, found.ids.get(number, [])),
        )
        for number in numbers
    ]
    source = Source(path=path, views=posed(where, views, notify), metric=True, direction="world-to-camera")
    return replace(source, id_names=found.names)


def _images(path: Path) -> dict[int, Path]:
    return next((found for name in _FOLDERS if (found := numbered(path / name, COLOUR))), {})


def _lens(where: Path, number: int, camera: _Camera, image: Path) -> Lens:
    k = camera.cam_K
    if len(k) != 9 or not (k[0] > 0 and k[4] > 0 and camera.depth_scale > 0):
        raise CaptureError(f"{where}: cam_K or depth_scale of {number} make no sense. Download the scene again.")
    width, height = image_size(image)
    return Lens(width, height, (k[0], k[4]), (k[2] + CENTRE, k[5] + CENTRE))


def _matrix(turn: list[float], shift_mm: list[float]) -> Float64[np.ndarray, "4 4"]:
    matrix = np.full((4, 4), np.nan)
    if len(turn) == 9 and len(shift_mm) == 3:
        matrix = np.eye(4)
        matrix[:3, :3] = np.reshape(turn, (3, 3))
        matrix[:3, 3] = np.array(shift_mm, np.float64) / MILLIMETRES
    return matrix


def _poses(
    where: Path, numbers: list[int], cameras: dict[int, _Camera], truth: _Truth, notify: Listener
) -> dict[int, Float64[np.ndarray, "4 4"]]:
    """Camera to world; not finite where an image has none."""
    stated = {number: cameras[number] for number in numbers if cameras[number].cam_R_w2c is not None}
    if stated:
        inverse = {number: _matrix(camera.cam_R_w2c or [], camera.cam_t_w2c or []) for number, camera in stated.items()}
    else:
        anchor = _anchor(where, numbers, truth)
        warn(notify, f"no camera has a pose in the world: object {anchor}, if it lies still, is the world")
        entries = {number: next(item for item in truth[number] if item.obj_id == anchor) for number in numbers}
        inverse = {number: _matrix(item.cam_R_m2c, item.cam_t_m2c) for number, item in entries.items()}
    lost = np.full((4, 4), np.nan)
    return {number: _inverted(inverse.get(number, lost)) for number in numbers}


def _anchor(where: Path, numbers: list[int], truth: _Truth) -> int:
    """The first object that every image has just once."""
    single = [
        {item.obj_id for item in entries if sum(other.obj_id == item.obj_id for other in entries) == 1}
        for entries in (truth.get(number, []) for number in numbers)
    ]
    common = set.intersection(*single) if single else set()
    if not common:
        text = f"{where}: no cam_R_w2c, and no object of scene_gt.json is in every image once"
        raise CaptureError(f"{text}: nothing tells where the cameras stood. Choose a scene with camera poses.")
    return min(common)


def _inverted(matrix: Float64[np.ndarray, "4 4"]) -> Float64[np.ndarray, "4 4"]:
    if not np.isfinite(matrix).all():
        return matrix
    inverse = np.eye(4)
    inverse[:3, :3] = matrix[:3, :3].T
    inverse[:3, 3] = -matrix[:3, :3].T @ matrix[:3, 3]
    return inverse


def _instances(numbers: list[int], poses: dict[int, Float64[np.ndarray, "4 4"]], truth: _Truth) -> _Instances:
    """Entries of one object within 5 cm in the world are one instance; alone of its kind it has the object's number."""
    places: list[tuple[int, Float64[np.ndarray, "3"]]] = []
    seen: dict[int, list[int]] = {}
    for number in numbers:
        seen[number] = []
        for item in truth.get(number, []):
            place = (poses[number] @ _matrix(item.cam_R_m2c, item.cam_t_m2c))[:3, 3]
            same = [at for at, (kind, other) in enumerate(places) if kind == item.obj_id and _near(place, other)]
            if not same:
                places.append((item.obj_id, place))
            seen[number].append(same[0] if same else len(places) - 1)
    kinds = [kind for kind, _ in places]
    alone = len(set(kinds)) == len(kinds) and all(kind > 0 for kind in kinds)
    ids = kinds if alone else [at + 1 for at in range(len(kinds))]
    names = {number: f"object {kind}" for number, kind in zip(ids, kinds, strict=True)}
    return _Instances({number: [ids[at] for at in found] for number, found in seen.items()}, names)


def _near(one: Float64[np.ndarray, "3"], other: Float64[np.ndarray, "3"]) -> bool:
    return bool(np.linalg.norm(one - other) < _SAME_PLACE_M)


def _masks(path: Path, number: int, ids: list[int]) -> ObjectMasks | None:
    if not is_folder(path / "mask_visib"):
        return None
    files = [(value, path / "mask_visib" / f"{number:06}_{index:06}.png") for index, value in enumerate(ids)]
    there = tuple((value, file) for value, file in files if is_file(file))
    return ObjectMasks(there) if there else None


READER = Reader(name="BOP", expects="scene_camera.json and rgb/ (BOP)", detect=detect, read=read)
