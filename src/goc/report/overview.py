"""overview.png: views, depth, ids, the scene and its objects in one picture, to judge a run by."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8

from goc.events import Progress
from goc.files import write_png
from goc.raster import render
from goc.report.canvas import ALARM, FAINT, Canvas
from goc.report.palette import colour_of_id, colours_of_depth, colours_of_ids
from goc.report.portraits import dollhouse, portrait
from goc.report.report import filled_share
from goc.runs.record import RunRecord
from goc.scene import ROOM, UNLABELLED, Capture, Gaussians, Mesh, Scene, SceneObject

_WIDTH, _MARGIN, _GAP = 1720, 40, 12
_INNER = _WIDTH - 2 * _MARGIN
_TITLE_PX, _TEXT_PX, _SMALL_PX = 34, 19, 16
_ACROSS = 6
"""Tiles in a row; the scene takes a square of four."""
_TILE = (_INNER - (_ACROSS - 1) * _GAP) // _ACROSS
_CAPTION = 56
_ID_SHARE = 0.65
"""Share of an id's colour in the ids column; the rest is the grey of the render, so that shapes stay visible."""
_CANDIDATES = 40
"""Number of views among which those to show are chosen."""
_EASY = 0.02
"""Share of a picture from which on a larger object is seen no better."""
_WARNINGS_SHOWN = 4
_NOTHING = Mesh(vertices=np.zeros((0, 3), np.float32), faces=np.zeros((0, 3), np.int32))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Row:
    """One view as photograph, render, depth and ids."""

    name: str
    psnr_db: float
    photo: UInt8[np.ndarray, "h w 3"]
    shown: UInt8[np.ndarray, "h w 3"]
    depth: Float64[np.ndarray, "h w"]
    """Metres."""
    ids: UInt8[np.ndarray, "h w 3"]


def write_overview(path: Path, scene: Scene, views: Capture, title: str, count: int, run: RunRecord) -> None:
    """Draw overview.png and write it; see `draw_overview`.

    Raises:
        FileError: the disk refuses.
    """
    write_png(path, draw_overview(scene, views, title, count, run))


def draw_overview(scene: Scene, views: Capture, title: str, count: int, run: RunRecord) -> UInt8[np.ndarray, "h w 3"]:
    """Real views beside renders, depth and ids; the scene; and every object from its own best angle, with its name.

    Args:
        scene: the result of the run.
        views: photographs with the splats' depth and ids (`rendered_views`).
        title: name of the capture.
        count: number of views to show, or all if there are fewer.
        run: its warnings are shown; it is notified of one Progress for each picture.
    """
    chosen = choose_views(views, count)
    total = len(chosen) + 1 + len(scene.objects)
    steps = iter(range(1, total + 1))

    def step() -> None:
        run(Progress(stage="export", done=next(steps), total=total))

    rows = []
    for index in chosen:
        rows.append(_row(scene.splats, views, index))
        step()
    tiles = [dollhouse(scene.mesh, scene.world.up, 2 * _TILE + _GAP)]
    step()
    for item in scene.objects:
        mesh = _NOTHING if item.surface is None else item.surface.mesh
        tiles.append(portrait(mesh, scene.world.up, _TILE))
        step()
    bands = [_header(scene, views, title, run), *_view_bands(rows), _tile_band(scene, tiles)]
    return np.concatenate(bands)


def choose_views(views: Capture, count: int) -> list[int]:
    """Indices of views that together show most objects, ascending. Each choice adds most to those made before."""
    candidates = sorted({round(place) for place in np.linspace(0, len(views) - 1, min(_CANDIDATES, len(views)))})
    areas = {index: _areas(views, index) for index in candidates}
    best: dict[int, float] = {}
    chosen: list[int] = []
    for _ in range(min(count, len(candidates))):
        left = [index for index in candidates if index not in chosen]
        gains = [sum(max(0.0, area - best.get(i, 0.0)) for i, area in areas[index].items()) for index in left]
        # If no view adds anything, take the one in the middle of the widest gap.
        pick = left[int(np.argmax(gains))] if max(gains) > 0 else max(left, key=lambda index: _apart(index, chosen))
        chosen.append(pick)
        for number, area in areas[pick].items():
            best[number] = max(best.get(number, 0.0), area)
    return sorted(chosen)


def _areas(views: Capture, index: int) -> dict[int, float]:
    """Size of each object in a view by id: the square root of its share of the pixels, which is capped at `_EASY`."""
    ids = views[index].ids
    if ids is None:
        return {}
    names, pixels = np.unique(ids.numpy(), return_counts=True)
    shares = zip(names.tolist(), (pixels / ids.numel()).tolist(), strict=True)
    return {name: min(share, _EASY) ** 0.5 for name, share in shares if name not in (ROOM, UNLABELLED)}


def _apart(index: int, chosen: Sequence[int]) -> int:
    return min((abs(index - other) for other in chosen), default=0)


def _row(splats: Gaussians, views: Capture, index: int) -> _Row:
    frame = views[index]
    photo = frame.image.numpy()
    seen = render(splats, frame.camera).colour.numpy()
    grey = seen.mean(-1, keepdims=True) * 255
    height, width = photo.shape[:2]
    ids = np.full((height, width), UNLABELLED, np.int16) if frame.ids is None else frame.ids.numpy()
    depth = (
        np.full((height, width), np.nan)
        if frame.depth is None
        else frame.depth.double().numpy() / views.units_per_metre
    )
    error = np.square(seen - photo / 255.0).mean()
    return _Row(
        name=views.view_names[index],
        psnr_db=-10 * math.log10(max(float(error), 1e-10)),
        photo=photo,
        shown=np.rint(seen * 255).astype(np.uint8),
        depth=depth,
        ids=np.rint(_ID_SHARE * colours_of_ids(ids) + (1 - _ID_SHARE) * grey).astype(np.uint8),
    )


def _header(scene: Scene, views: Capture, title: str, run: RunRecord) -> UInt8[np.ndarray, "h w 3"]:
    heard = [f"{warning.stage}: {warning.message}" for warning in run.warnings]
    lines = heard[:_WARNINGS_SHOWN]
    if len(heard) > len(lines):
        lines.append(f"and {len(heard) - len(lines)} more warnings: see report.json")
    canvas = Canvas(_WIDTH, 126 + 26 * len(lines))
    canvas.text(title, _MARGIN, 30, _TITLE_PX, _INNER)
    canvas.text(" · ".join(_facts(scene, views)), _MARGIN, 80, _TEXT_PX, _INNER, FAINT)
    for place, line in enumerate(lines):
        canvas.text(line, _MARGIN, 110 + 26 * place, _TEXT_PX, _INNER, ALARM)
    return canvas.pixels()


def _facts(scene: Scene, views: Capture) -> Iterator[str]:
    camera, metrics = views.cameras[0], scene.metrics
    yield f"{len(views)} views of {camera.width} x {camera.height}"
    yield f"{len(scene.splats):,} splats"
    for key, words in (("held_out_psnr_db", "held-out views"), ("train_psnr_db", "training views")):
        if key in metrics:
            yield f"{metrics[key]:.1f} dB on {words}"
    yield f"{len(scene.mesh.faces):,} faces"
    yield f"{len(scene.objects)} object" + "s" * (len(scene.objects) != 1)
    if not scene.world.metric:
        yield "scale guessed"


def _view_bands(rows: Sequence[_Row]) -> Iterator[UInt8[np.ndarray, "_ _ 3"]]:
    cell = (_INNER - 3 * _GAP) // 4
    known = np.concatenate([row.depth[np.isfinite(row.depth)] for row in rows])
    near, far = np.percentile(known, [1, 99]) if len(known) else (0.0, 1.0)
    canvas = Canvas(_WIDTH, 34)
    names = ("photograph", "splats, rendered", f"their depth, {near:.1f} to {far:.1f} m", "their objects")
    for place, name in enumerate(names):
        canvas.text(name, _MARGIN + place * (cell + _GAP), 4, _TEXT_PX, cell)
    yield canvas.pixels()
    for row in rows:
        height = min(round(cell * row.photo.shape[0] / row.photo.shape[1]), round(1.2 * cell))
        canvas = Canvas(_WIDTH, height + 34)
        pictures = (row.photo, row.shown, colours_of_depth(row.depth, near, far), row.ids)
        for place, picture in enumerate(pictures):
            canvas.picture(picture, _MARGIN + place * (cell + _GAP), 0, cell, height)
        canvas.text(row.name, _MARGIN, height + 4, _SMALL_PX, cell, FAINT)
        canvas.text(f"{row.psnr_db:.1f} dB", _MARGIN + cell + _GAP, height + 4, _SMALL_PX, cell, FAINT)
        yield canvas.pixels()


def _tile_band(scene: Scene, tiles: Sequence[UInt8[np.ndarray, "_ _ 3"]]) -> UInt8[np.ndarray, "h w 3"]:
    """The scene, two tiles wide and high, and the objects around and below it."""
    pitch = _TILE + _CAPTION
    beside = [(row, column) for row in range(2) for column in range(2, _ACROSS)]
    count = len(scene.objects)
    below = [divmod(place, _ACROSS) for place in range(max(0, count - len(beside)))]
    places = (beside + [(row + 2, column) for row, column in below])[:count]
    lines = 2 + math.ceil(len(below) / _ACROSS)
    canvas = Canvas(_WIDTH, 24 + lines * pitch + _MARGIN // 2)
    side = 2 * _TILE + _GAP
    canvas.picture(tiles[0], _MARGIN, 24, side, side)
    canvas.text("the scene's mesh", _MARGIN, 24 + side + 8, _TEXT_PX, side)
    for item, tile, (row, column) in zip(scene.objects, tiles[1:], places, strict=True):
        x, y = _MARGIN + column * (_TILE + _GAP), 24 + row * pitch
        canvas.picture(tile, x, y, _TILE, _TILE)
        canvas.chip(x, y + _TILE + 9, 16, colour_of_id(item.id))
        canvas.text(f"{item.id} · {item.name}", x + 24, y + _TILE + 5, _TEXT_PX, _TILE - 24)
        words = _measures(item, scene.world.units_per_metre)
        canvas.text(words, x + 24, y + _TILE + 29, _SMALL_PX, _TILE - 24, FAINT)
    return canvas.pixels()


def _measures(item: SceneObject, units_per_metre: float) -> str:
    if item.surface is None or not len(item.surface.mesh.vertices):
        return "no surface"
    mesh = item.surface.mesh
    sides = (mesh.vertices.max(0) - mesh.vertices.min(0)) / units_per_metre
    size = " x ".join(f"{side:.2f}" for side in sides) + " m"
    if item.solid is None:
        return f"{size} · {_thousands(len(mesh.faces))} faces"
    return f"{size} · {filled_share(item.solid):.0%} filled"


def _thousands(count: int) -> str:
    return f"{count:,}" if count < 10_000 else f"{round(count / 1000):,}k"
