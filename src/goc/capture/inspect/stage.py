"""A capture in, all that can be told of it out, in seconds."""

import math
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from goc.capture.assemble import assemble
from goc.capture.checks import findings
from goc.capture.config import CaptureConfig
from goc.capture.inspect.damage import blurred_views, exposure_jumps, poses_off, rarely_seen, unsteady_ids
from goc.capture.inspect.inspection import DepthFacts, FindingFacts, Inspection, ObjectFacts, Size
from goc.capture.inspect.looks import Look, look_at
from goc.capture.inspect.pairs import Shared, shared_points
from goc.capture.load import read_source, reader_of
from goc.capture.source import Source
from goc.events import Listener, ignore
from goc.geometry.gravity import camera_up
from goc.scene import Capture


@dataclass(frozen=True, kw_only=True, eq=False)
class Inspected:
    """What was found, and the small pictures that show it."""

    inspection: Inspection
    looks: tuple[Look, ...]
    capture: Capture


def inspect_capture(path: Path, config: CaptureConfig | None = None, notify: Listener = ignore) -> Inspected:
    """Look at a capture: what it holds, whether it agrees with itself, and which views and ids are damaged.

    Contradictions are findings here, not errors.

    Raises:
        CaptureError: nothing here is a capture, or files are missing.
        FileError: a file is malformed.
    """
    config = replace(config or CaptureConfig(), checks="warn")
    source = read_source(path, config, notify)
    capture = assemble(source, config, notify)
    looks = look_at(source, capture, notify)
    shared = list(shared_points(looks)) if capture.has_metric_depth else []
    told = [
        FindingFacts(check=f.check, severity=f.severity, message=f.message) for f in findings(source, capture, config)
    ]
    inspection = _inspection(path, source, capture, looks, shared, told)
    return Inspected(inspection=inspection, looks=looks, capture=capture)


def _inspection(
    path: Path,
    source: Source,
    capture: Capture,
    looks: tuple[Look, ...],
    shared: list[Shared],
    told: list[FindingFacts],
) -> Inspection:
    off, gap = poses_off(looks, shared, capture.units_per_metre)
    poses = np.stack([camera.world_from_cam.double().numpy() for camera in capture.cameras])
    views_of = Counter(number for look in looks for number in look.areas)
    x, y, z = camera_up(poses).tolist()
    return Inspection(
        path=str(path),
        format=reader_of(path).name,
        views=len(capture),
        looked_at=len(looks),
        sizes=_sizes(capture),
        lenses=sorted({view.lens.projection for view in source.views}),
        depth=_depth(capture, looks, gap),
        has_ids=capture.has_ids,
        objects=_objects(capture, looks, views_of),
        seed_points=0 if capture.points is None else len(capture.points.positions),
        metric=capture.metric,
        units_per_metre=capture.units_per_metre,
        up=(x, y, z),
        path_m=_longest(poses[:, :3, 3]) / capture.units_per_metre,
        findings=sorted(told, key=lambda one: one.severity),
        damage=[*off, *blurred_views(looks), *exposure_jumps(looks, shared)],
        ids_damage=unsteady_ids(looks, shared),
        few_views=rarely_seen(dict(views_of), len(looks)),
    )


def _sizes(capture: Capture) -> list[Size]:
    groups = Counter(
        (camera.width, camera.height, round(_degrees(max(camera.width, camera.height), float(camera.focal_px.max()))))
        for camera in capture.cameras
    )
    return [Size(width=w, height=h, views=count, degrees=d) for (w, h, d), count in groups.most_common()]


def _degrees(side: int, focal: float) -> float:
    return math.degrees(2 * math.atan(side / 2 / focal))


def _depth(capture: Capture, looks: tuple[Look, ...], gap: float | None) -> DepthFacts | None:
    depths = [look.depth for look in looks if look.depth is not None]
    if not depths:
        return None
    values = np.concatenate([depth.ravel() for depth in depths])
    known = np.isfinite(values)
    middle = float(np.median(values[known])) / capture.units_per_metre if known.any() else None
    return DepthFacts(
        kind=capture.depth_kind,
        views=len(depths),
        covered=round(float(known.mean()), 4),
        median_m=middle if capture.depth_kind == "metric" else None,
        gap_cm=gap,
    )


def _objects(capture: Capture, looks: tuple[Look, ...], views_of: Counter[int]) -> list[ObjectFacts]:
    largest = {number: max(look.areas.get(number, 0.0) for look in looks) for number in views_of}
    return [
        ObjectFacts(
            id=number,
            name=capture.id_names.get(number, f"object {number}"),
            views=views_of[number],
            largest=round(largest[number], 5),
        )
        for number in sorted(views_of)
    ]


def _longest(positions: np.ndarray) -> float:
    some = positions[:: max(1, len(positions) // 200)]
    return float(np.linalg.norm(some[:, None] - some[None], axis=-1).max())
