"""Reader of ScanNet scenes as its tools export them (Dai et al. 2017).

color/0.jpg  depth/0.png  pose/0.txt       numbers without zeros before them; millimetres; camera to world, OpenCV axes
intrinsic/intrinsic_color.txt              4 x 4
instance-filt/0.png                        8 bits: 0 = nobody annotated it, else objectId + 1; or *-instance-filt.zip
SCENE.aggregation.json                     labels of objectIds
label-filt/0.png                           16 bits, raw label ids, which scannetv2-labels.combined.tsv maps
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec

from goc.capture.config import CaptureConfig
from goc.capture.packed import PackedPicture, zip_extents
from goc.capture.readers.labels import classes_of, is_room, table_of
from goc.capture.readers.reader import Reader
from goc.capture.readers.recording import (
    CENTRE,
    COLOUR,
    demand,
    first_with,
    numbered,
    paired,
    posed,
    read_all,
    thinned,
    warn,
)
from goc.capture.source import IdCodes, Lens, Pixels, Source, View
from goc.errors import CaptureError
from goc.events import Listener
from goc.files import image_size, is_file, is_folder, read_bytes, read_json, read_matrix

_IDS, _LABELS = "instance-filt", "label-filt"
_TABLE = "scannetv2-labels.combined.tsv"
# Raw labels of what bounds a room, for scenes without a table of labels: wall, floor, door, window, curtain, ceiling, …
_ROOM_LABELS = frozenset({1, 3, 5, 16, 21, 41, 128, 161, 232})
_NYU40_ROOM = frozenset({1, 2, 8, 9, 16, 19, 22})  # wall, floor, door, window, curtain, mirror, ceiling
_LIMIT = 64 << 20
_MOST_IDS = 255  # of eight bits


class _Group(msgspec.Struct):
    objectId: int  # noqa: N815 - ScanNet's spelling
    label: str


class _Aggregation(msgspec.Struct):
    segGroups: list[_Group]  # noqa: N815


def detect(path: Path) -> bool:
    """Whether `path` is a folder with color/ (or pose/) and intrinsic/."""
    return is_folder(path / "intrinsic") and (is_folder(path / "color") or is_folder(path / "pose"))


def read(path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Read an exported scene.

    Raises:
        FileError: a file is malformed.
        CaptureError: a part is missing, or a pose is finite and not rigid.
    """
    where = path / "intrinsic" / "intrinsic_color.txt"
    needed = [(f"{name}/", is_folder(path / name)) for name in ("color", "pose")]
    demand(path, "ScanNet", [*needed, ("intrinsic/intrinsic_color.txt", is_file(where))])
    images, poses = numbered(path / "color", COLOUR), numbered(path / "pose", (".txt",))
    demand(path, "ScanNet", [("images in color/", bool(images))])
    numbers = thinned(paired(path, images, poses, "pose", config, notify), config, notify)
    lens = _lens(where, images[numbers[0]])
    depth, has_depth = numbered(path / "depth", (".png",)), is_folder(path / "depth")
    files = [poses[number] for number in numbers]
    matrices = read_all(path / "pose", files, partial(read_matrix, finite=False), "poses")
    views = {
        number: View(
            name=f"color/{images[number].name}",
            lens=lens,
            world_from_cam=matrix,
            image=images[number],
            depth=depth.get(number, path / "depth" / f"{number}.png") if has_depth else None,
        )
        for number, matrix in zip(numbers, matrices, strict=True)
    }
    return annotated(Source(path=path, views=(), metric=True, up=(0.0, 0.0, 1.0)), views, path, config, notify)


def annotated(source: Source, views: dict[int, View], path: Path, config: CaptureConfig, notify: Listener) -> Source:
    """Add views to a source, by their numbers, with the annotations of a folder, and leave out those that were lost.

    Raises:
        FileError: an annotation is damaged.
        CaptureError: a pose is finite and not rigid.
    """
    ids = _images(path, _IDS) if config.use_ids else {}
    with_ids = {number: replace(view, ids=ids.get(number)) for number, view in views.items()}
    kept = posed(source.path, list(with_ids.values()), notify)
    source = replace(source, views=kept)
    if not any(view.ids is not None for view in kept):
        return source
    numbers = {view.name: number for number, view in views.items()}
    return _labelled(source, path, [numbers[view.name] for view in kept], notify)


def _lens(where: Path, image: Path) -> Lens:
    width, height = image_size(image)
    matrix = read_matrix(where)
    if matrix.shape not in ((3, 3), (4, 4)) or not (matrix[0, 0] > 0 and matrix[1, 1] > 0):
        raise CaptureError(f"{where}: expected a 4 x 4 matrix with focal lengths. Export the scene again.")
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Lens(width, height, (fx, fy), (cx + CENTRE, cy + CENTRE))


def _images(path: Path, name: str) -> dict[int, Pixels]:
    """Annotations of one kind by number, from their folder or from the archive that ScanNet has of it."""
    files = numbered(path / name, (".png",))
    archives = sorted(path.glob(f"*{name}.zip"))
    if files or not archives:
        return dict(files)
    pieces = zip_extents(archives[0], lambda entry: re.fullmatch(rf"(.*/)?{name}/\d+\.png", entry) is not None)
    return {int(Path(entry).stem): PackedPicture(piece, codes=True) for entry, piece in pieces.items()}


def _labelled(source: Source, path: Path, numbers: list[int], notify: Listener) -> Source:
    """Tell the instances of the room from things, by whatever labels there are."""
    aggregations = sorted(path.glob("*aggregation.json"), key=lambda file: ("_vh_clean" in file.name, file.name))
    if aggregations:
        groups = read_json(aggregations[0], _Aggregation).segGroups
        names = {group.objectId + 1: group.label for group in groups if 0 <= group.objectId < _MOST_IDS}
        rooms = [number for number, name in names.items() if is_room(name)]
    else:
        names, rooms = _by_class(source.views, numbers, path)
    if not rooms:
        warn(notify, "no labels tell walls and floor from things (*.aggregation.json): each is an object")
    names = {number: name for number, name in names.items() if number not in set(rooms)}
    return replace(source, id_codes=IdCodes(table=table_of(rooms, absent=0, most=_MOST_IDS)), id_names=names)


def _by_class(views: Sequence[View], numbers: list[int], path: Path) -> tuple[dict[int, str], list[int]]:
    labels = _images(path, _LABELS)
    pairs = [(view.ids, labels[number]) for view, number in zip(views, numbers, strict=True) if number in labels]
    table = first_with(path, [_TABLE]) or first_with(path.resolve().parent, [_TABLE])
    kinds = _table(table) if table else {}
    names, rooms = {}, []
    for instance, label in classes_of([(ids, kind) for ids, kind in pairs if ids is not None]).items():
        name, nyu40 = kinds.get(label, ("", None))
        if instance > 0 and (nyu40 in _NYU40_ROOM if kinds else label in _ROOM_LABELS):
            rooms.append(instance)
        elif instance > 0 and name:
            names[instance] = name
    return names, rooms


def _table(path: Path) -> dict[int, tuple[str, int | None]]:
    """Name and NYU40 class of each raw label."""
    lines = read_bytes(path, _LIMIT).decode("utf-8", "replace").splitlines()
    header = lines[0].split("\t") if lines else []
    if not {"id", "raw_category", "nyu40id"} <= set(header):
        raise CaptureError(f"{path}: lacks the columns id, raw_category and nyu40id. Download it again.")
    at = [header.index(name) for name in ("id", "raw_category", "nyu40id")]
    rows = [line.split("\t") for line in lines[1:]]
    cells = [[row[column] for column in at] for row in rows if len(row) > max(at)]
    return {int(raw): (name, int(nyu) if nyu.isdigit() else None) for raw, name, nyu in cells if raw.isdigit()}


READER = Reader(
    name="ScanNet", expects="color/, depth/, pose/ and intrinsic/ (ScanNet, exported)", detect=detect, read=read
)
