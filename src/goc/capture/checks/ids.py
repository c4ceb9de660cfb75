"""Checks of instance ids: what is no coding of objects at all. Whether views agree is the repair's question (0049)."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float64, Int16

from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.sample import Sample
from goc.capture.pixels import path_of
from goc.capture.source import Source, count_of, shown
from goc.scene import ROOM, UNLABELLED

_LOSSY = (".jpg", ".jpeg", ".webp")
_MANY = 200
"""Ids in one view, from which on they are hardly things."""
_FEW_VIEWS = 6
_ENCLOSED = 0.8
"""Share of the cameras that walls have on all sides."""


def id_findings(sample: Sample) -> Iterator[Finding]:
    """What ids tell of themselves, and from view to view."""
    images = [
        (sample.capture.view_names[row], frame.ids.numpy())
        for row, frame in zip(sample.indices, sample.frames, strict=True)
        if frame.ids is not None
    ]
    if not images:
        return
    yield from _lossy(sample.source)
    values = np.unique(np.concatenate([np.unique(ids) for _, ids in images]))
    if not (values > ROOM).any():
        yield _no_objects(values, len(images))
        return
    yield from _codings(images)
    yield from _surroundings(sample)


def _no_objects(values: Int16[np.ndarray, "k"], views: int) -> Finding:
    holds = "hold nothing but 0, the room"
    if (values == UNLABELLED).any():
        holds = "hold nothing but 255, which means unlabelled"
        holds = "hold only 0 and 255, and 255 means unlabelled" if (values == ROOM).any() else holds
    return contradiction(
        "ids-no-object",
        f"the id images {holds} ({views} views were looked at): no object would come out. Number objects from 1, "
        "or pass --capture.no-use-ids.",
    )


def _codings(images: Sequence[tuple[str, Int16[np.ndarray, "_ _"]]]) -> Iterator[Finding]:
    crowded = [name for name, ids in images if len(np.unique(ids)) > _MANY]
    if crowded:
        yield doubt(
            "ids-many",
            f"{count_of(crowded, len(images))} id images hold more than {_MANY} ids (first: {shown(crowded[0])}): they "
            "look like superpixels, depth or colours rather than objects",
        )
    whole = [name for name, ids in images if _largest_share(ids) > 0.97]
    if len(whole) == len(images):
        yield doubt("ids-one", "one id covers every view: the room is 0, objects count from 1")


def _largest_share(ids: Int16[np.ndarray, "h w"]) -> float:
    """Share of the image that the largest object covers."""
    numbers, counts = np.unique(ids[ids > ROOM], return_counts=True)
    return float(counts.max() / ids.size) if len(numbers) else 0.0


def _lossy(source: Source) -> Iterator[Finding]:
    paths = [path_of(view.ids) for view in source.views if view.ids is not None]
    lossy = [path.name for path in paths if path.suffix.lower() in _LOSSY]
    if lossy:
        yield contradiction(
            "ids-lossy",
            f"{count_of(lossy, len(paths))} id images are JPEG or WebP (first: {shown(lossy[0])}), which change ids. "
            "Write PNG, or pass --capture.no-use-ids.",
        )


def _surroundings(sample: Sample) -> Iterator[Finding]:
    """An object is never on all sides of the cameras: walls are."""
    if not sample.capture.has_metric_depth or len(sample.frames) < _FEW_VIEWS:
        return
    points, numbers = _labelled_points(sample)
    cameras = np.stack([frame.camera.position.double().numpy() for frame in sample.frames])
    scene = np.ptp(np.quantile(points, [0.02, 0.98], axis=0), axis=0)
    around, flat = [], []
    for number in np.unique(numbers[numbers > ROOM]):
        mine = points[numbers == number]
        low, high = np.quantile(mine, [0.02, 0.98], axis=0)
        enclosed = ((cameras > low) & (cameras < high)).all(1).mean()
        if enclosed > _ENCLOSED and len(mine) > 0.1 * len(points):
            around.append(int(number))
        elif (high - low > 0.8 * scene).sum() == 2 and (high - low < 0.1 * scene).any():
            flat.append(int(number))
    if around:
        listed = " ".join(map(str, sorted(around + flat)))
        yield contradiction(
            "ids-room",
            f"id {around[0]} surrounds the cameras: walls, floor or ceiling are instances of their own, as ScanNet has "
            f"them. Pass --capture.convention.room-ids {listed} (those that look so), or write 0 for the room.",
        )


def _labelled_points(sample: Sample) -> tuple[Float64[np.ndarray, "p 3"], Int16[np.ndarray, "p"]]:
    """Some world points of the sampled views, with their ids."""
    points, numbers = [], []
    for frame in sample.frames:
        if frame.depth is not None and frame.ids is not None:
            step = max(1, frame.camera.width // 60)
            world = frame.camera.double().unproject_depth(frame.depth.double())[::step, ::step].reshape(-1, 3)
            known = world.isfinite().all(-1)
            points.append(world[known].numpy())
            numbers.append(frame.ids[::step, ::step].reshape(-1)[known].numpy())
    return np.concatenate(points), np.concatenate(numbers)
