"""Checks of instance ids: what is no coding of objects at all, and what does not hold still."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Float64, Int16

from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.sample import Sample
from goc.capture.pixels import path_of
from goc.capture.source import Source, count_of, shown
from goc.scene import ROOM, UNLABELLED, Frame

_LOSSY = (".jpg", ".jpeg", ".webp")
_MANY = 200
"""Ids in one view, from which on they are hardly things."""
_THIN_IDS, _THIN_SHARE = 4, 0.4
"""Ids in the median view that exist only along edges, and their share of its ids, from which on they are mixtures."""
_SAME, _SAME_SURELY = 0.85, 0.35
"""Share of points of objects whose id is the same in another view."""
_FEWEST = 150
_FEW_VIEWS = 6
_ENCLOSED = 0.8
"""Share of the cameras that walls have on all sides."""
_CLOSE = 0.03


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
    yield from _from_view_to_view(sample)


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


def _from_view_to_view(sample: Sample) -> Iterator[Finding]:
    """The same point of an object, seen in two views, has the same id."""
    if not sample.capture.has_metric_depth:
        return
    same = compared = 0
    frames = [frame for frame in sample.frames if frame.ids is not None and frame.depth is not None]
    for here in frames:
        for there in frames:
            if here is not there:
                equal, number = _compared(here, there)
                same, compared = same + equal, compared + number
    if compared < _FEWEST or same >= _SAME * compared:
        return
    share = same / compared
    told = f"of points of objects that two views share, {100 * share:.0f} % have the same id in both"
    kind = "were given in each view anew" if share < _SAME_SURELY else "flicker, swap, or are split in some views"
    yield doubt("ids-change", f"{told}: ids {kind}. `goc carve` repairs them, unless --ids keep is passed")


def _compared(here: Frame, there: Frame) -> tuple[int, int]:
    """Points of one view's objects that another view sees and labels: with the same id, and all."""
    assert here.depth is not None and here.ids is not None and there.depth is not None and there.ids is not None
    step = max(1, here.camera.width // 40)
    points = here.camera.double().unproject_depth(here.depth.double())[::step, ::step]
    mine = here.ids[::step, ::step]
    pixels, z = there.camera.double().project(points)
    size = torch.tensor([there.camera.width, there.camera.height])
    inside = ((pixels >= 0) & (pixels < size)).all(-1) & (mine > ROOM)
    x, y = pixels[inside].long().unbind(-1)
    seen, other = there.depth[y, x], there.ids[y, x]
    agree = ((z[inside] / seen - 1).abs() < _CLOSE) & (other != UNLABELLED)
    return int((other[agree] == mine[inside][agree]).sum()), int(agree.sum())
