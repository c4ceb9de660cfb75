"""Reader of the captures of MonoSDF and its descendants: ObjectSDF++, RICO, PhyRecon, DP-Recon.

000000_rgb.png  000000_depth.npy  000000_normal.npy  000000_mask.npy       or image/000000.png, mask/000000.png (IDR)
cameras.npz                world_mat_i = K · [R t], world to camera, the first pixel centred at 0; scale_mat_i
segs/000000_segs.png       instance_mapping.txt: raw, semantic, new        (ObjectSDF++; new 0 is the room)
instance_mask/000000.png   instance_id.json: {name: id}                    (RICO and later; other values are the room)

Depth is a network's, known to a scale and an offset; normals are (v + 1) / 2 in OpenCV camera axes. world_mat alone
gives the pose in metres: times scale_mat, which is not read, it would be that of the codes' own unit sphere.
"""

import io
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64
from scipy.linalg import rq

from goc.capture.config import CaptureConfig
from goc.capture.pixels import Pixels
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import CENTRE, COLOUR, demand, numbered, posed, thinned, warn
from goc.capture.source import IdCodes, Lens, Source, View, complain
from goc.errors import CaptureError, FileError
from goc.events import Listener
from goc.files import image_size, is_file, read_bytes, read_json
from goc.scene import ROOM, UNLABELLED

_CAMERAS = ("cameras.npz", "cameras_sphere.npz")
_LIMIT = 256 << 20
_CENTRAL = 0.15
_SKEW = 1e-3
_MOST_IDS = 255
_SURE = 0.5
_DTYPES = "uif"


def detect(path: Path) -> bool:
    """Whether `path` is a folder with cameras.npz and images, or with N_rgb.png and N_depth.npy."""
    images = _images(path)
    stated = any(is_file(path / name) for name in _CAMERAS)
    return bool(images and stated) or bool(numbered(path, (".png",), r"(\d+)_rgb") and _beside(path, "depth"))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read a scene.

    Raises:
        FileError: an array is malformed.
        CaptureError: cameras are missing, or their matrices are no products of intrinsics and a pose.
    """
    where = next((path / name for name in _CAMERAS if is_file(path / name)), path / _CAMERAS[0])
    images = _images(path)
    demand(path, "MonoSDF", [(where.name, is_file(where))])
    matrices = _matrices(where)
    lacking = [image.name for number, image in images.items() if number not in matrices]
    if lacking:
        raise complain(where, lacking, len(images), "images have no world_mat", "Copy the scene again.")
    indoor = bool(numbered(path, (".png",), r"(\d+)_rgb"))  # other scenes of IDR are not in metres
    depth, normals, sure = (_beside(path, kind) for kind in ("depth", "normal", "mask"))
    masks, ids = numbered(path / "mask", (".png",)), _ids(path, images) if config.use_ids else {}
    views, cropped = [], False
    for number in thinned(list(images), config, notify):
        matrix, pose = _decomposed(where, number, matrices[number])
        lens = _lens(matrix, *image_size(images[number]))
        cropped |= lens[1]
        views.append(
            View(
                name=str(images[number].relative_to(path)),
                lens=lens[0],
                world_from_cam=pose,
                image=images[number],
                depth=depth.get(number),
                normals=OmnidataNormals(normals[number]) if number in normals else None,
                confidence=sure.get(number) if number in depth else None,
                ids=ids.get(number),
                mask=masks.get(number),
            )
        )
    if cropped:
        warn(notify, "intrinsics are of images before they were cropped about their middle and scaled: corrected so")
    source = Source(path=path, views=posed(where, views, notify), metric=indoor, least_confidence=_SURE)
    source = replace(source, depth_units_per_metre=1.0, depth_kind="affine")
    return _labelled(source, path) if ids else source


@dataclass(frozen=True)
class OmnidataNormals:
    """Normals as Omnidata's networks write them: an array (3 h w) of (n + 1) / 2."""

    path: Path

    def size(self) -> tuple[int, int]:
        """Width and height."""
        _, height, width = self._array().shape
        return width, height

    def read(self) -> Float32[np.ndarray, "h w 3"]:
        """Unit vectors, NaN = none; raises FileError."""
        vectors = np.moveaxis(np.asarray(self._array(), np.float32), 0, -1) * 2 - 1
        length = np.linalg.norm(vectors, axis=-1, keepdims=True)
        with np.errstate(invalid="ignore"):
            return np.where(length > 0.5, vectors / np.maximum(length, 0.5), np.float32(np.nan))

    def _array(self) -> np.ndarray:
        try:
            array = np.lib.format.open_memmap(self.path, mode="r")  # no pickles
        except Exception as error:  # its header parser raises whatever Python's does
            raise FileError(f"{self.path}: not a readable .npy file ({error}). Copy it again.") from error
        if array.ndim != 3 or array.shape[0] != 3 or array.dtype.kind not in _DTYPES:
            raise FileError(f"{self.path}: expected normals (3 h w), found {array.shape} {array.dtype}. Copy it again.")
        return array


def _images(path: Path) -> dict[int, Path]:
    return numbered(path, (".png", ".jpg"), r"(\d+)_rgb") or numbered(path / "image", COLOUR)


def _beside(path: Path, kind: str) -> dict[int, Path]:
    return numbered(path, (".npy",), rf"(\d+)_{kind}")


def _matrices(path: Path) -> dict[int, Float64[np.ndarray, "3 4"]]:
    """world_mat of every view."""
    data = io.BytesIO(read_bytes(path, _LIMIT))
    try:
        loaded = np.load(data, allow_pickle=False)
        arrays = {name: np.asarray(loaded[name], np.float64) for name in loaded.files if name.startswith("world_mat_")}
    except Exception as error:  # zipfile and NumPy raise a dozen types
        raise FileError(f"{path}: not a readable .npz file ({error}). Copy it again.") from error
    found = {}
    for name, array in arrays.items():
        number = re.fullmatch(r"world_mat_(\d+)", name)
        if number and array.shape in ((4, 4), (3, 4)):
            found[int(number[1])] = array[:3]
    if not found:
        raise CaptureError(f"{path}: holds no world_mat_0, world_mat_1 and so on of 4 x 4. Copy the scene again.")
    return found


def _decomposed(
    where: Path, number: int, matrix: Float64[np.ndarray, "3 4"]
) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, "4 4"]]:
    """Intrinsics with a last element of 1, and camera to world; poses that were lost stay not finite."""
    pose = np.full((4, 4), np.nan)
    if not np.isfinite(matrix).all():
        return np.eye(3), pose
    matrix = matrix * (np.sign(np.linalg.det(matrix[:, :3])) or 1.0)
    upper, turn = rq(matrix[:, :3])
    signs = np.sign(np.diag(upper))
    if (signs == 0).any():
        raise CaptureError(f"{where}: world_mat_{number} is no product of intrinsics and a pose. Copy the scene again.")
    upper, turn = upper * signs, signs[:, None] * turn
    intrinsics = upper / upper[2, 2]
    if abs(intrinsics[0, 1]) > _SKEW * intrinsics[0, 0]:
        text = f"{where}: world_mat_{number} has skewed pixels, so it is no product of intrinsics and a pose"
        raise CaptureError(f"{text}. If scale_mat was multiplied in, undo it.")
    pose = np.eye(4)
    pose[:3, :3] = turn.T
    pose[:3, 3] = -turn.T @ np.linalg.solve(upper, matrix[:, 3])
    return intrinsics, pose


def _lens(matrix: Float64[np.ndarray, "3 3"], width: int, height: int) -> tuple[Lens, bool]:
    """The lens of an image, and whether it was cropped about its middle and scaled since the intrinsics were written.

    The codes crop and scale in their loaders by numbers of each data set; the principal point tells the original size.
    """
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    cx, cy = cx + CENTRE, cy + CENTRE
    if max(abs(cx / width - 0.5), abs(cy / height - 0.5)) < _CENTRAL:
        return Lens(width, height, (fx, fy), (cx, cy)), False
    scale = max(width / (2 * cx), height / (2 * cy))
    left, top = max(cx - width / scale / 2, 0.0), max(cy - height / scale / 2, 0.0)
    return Lens(width, height, (fx * scale, fy * scale), ((cx - left) * scale, (cy - top) * scale)), True


def _ids(path: Path, images: dict[int, Path]) -> dict[int, Pixels]:
    """Id images by number; those of other names are the images' in order, as the codes themselves take them."""
    files = numbered(path / "segs", (".png",), r"(\d+)_segs") or numbered(path / "instance_mask", (".png",))
    if files and set(files) != set(images) and len(files) == len(images):
        return dict(zip(images, files.values(), strict=True))
    return dict(files)


def _labelled(source: Source, path: Path) -> Source:
    if is_file(path / "instance_id.json"):
        named = read_json(path / "instance_id.json", dict[str, int])
        names = {number: name for name, number in named.items() if 0 <= number <= _MOST_IDS}
        return _with_codes(source, names, {number: True for number in names}, ROOM)
    if is_file(path / "instance_mapping.txt"):
        text = read_bytes(path / "instance_mapping.txt", _LIMIT).decode("ascii", "replace")
        rows = [re.findall(r"-?\d+", line) for line in text.splitlines()]
        return _with_codes(source, {}, {int(row[0]): int(row[2]) != 0 for row in rows if len(row) == 3}, UNLABELLED)
    return source


def _with_codes(source: Source, names: dict[int, str], is_object: dict[int, bool], others: int) -> Source:
    """Raw values stay ids, except for an object of value 0, which gets the first that is free."""
    free = max([0, *is_object]) + 1
    table = {value: (value or free) if thing else ROOM for value, thing in is_object.items()}
    if others == ROOM:
        table = dict.fromkeys(range(_MOST_IDS + 1), ROOM) | table
    kept = {table[value]: name for value, name in names.items()}
    return replace(source, id_codes=IdCodes(table=tuple(table.items()), others=others), id_names=kept)


READER = Reader(
    name="MonoSDF", expects="cameras.npz and 000000_rgb.png (MonoSDF, ObjectSDF++, RICO …)", detect=detect, read=read
)
