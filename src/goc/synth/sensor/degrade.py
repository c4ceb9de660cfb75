"""A degraded copy of a capture."""

import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from goc.errors import CaptureError, ConfigError
from goc.events import Listener, Progress, ignore
from goc.files import (
    is_file,
    is_folder,
    read_depth,
    read_ids,
    read_image,
    write_depth,
    write_ids,
    write_image,
    write_json,
    write_normals,
    write_png,
)
from goc.synth.folders import check_new
from goc.synth.sensor.depth import Lidar, StructuredLight, lidar_depth, structured_light_depth
from goc.synth.sensor.images import ImageFaults, degrade_image
from goc.synth.sensor.masks import corrupt_masks
from goc.synth.sensor.models import SensorConfig
from goc.synth.sensor.monocular import MonocularDepth, monocular_depth, monocular_normals
from goc.synth.sensor.poses import PoseFaults, perturb_pose
from goc.synth.sensor.source import FrameEntry, SourceCapture, link, read_source

_STAGE = "sensor"
_MILLIMETRE = 0.001
_RECORD = "sensor.json"
# Each fault has its own random numbers, so that none changes when another is switched.
_DEPTH, _NORMALS, _IMAGE, _POSE, _MASKS = range(5)


@dataclass(frozen=True, kw_only=True)
class _DegradedView:
    """The result of degrading one view."""

    changes: dict[str, Any] = field(default_factory=dict)
    """Keys of its frame that are different now."""
    truth: dict[str, Any] = field(default_factory=dict)
    """Exact values that a reader of the copy does not get: they go into gt/sensor.json."""


def degrade_capture(source: Path, out: Path, config: SensorConfig, notify: Listener = ignore) -> Path:
    """Write a copy of a capture as an imperfect sensor would have made it.

    Whatever no fault touches is shared with the source (hard links, or copies where the system has none), the ground
    truth in gt/ too, so that `goc eval` finds it. All transforms*.json of the folder are written, with the same noise.
    Monocular depth is marked with `"depth_kind"` in them. gt/sensor.json keeps the settings, and what the copy hides:
    exact poses, and scale and offset of each depth image.

    Args:
        source: folder in nerfstudio's layout, metric, with depth; or one transforms file.
        out: new or empty.
        config: which faults.
        notify: hears one Progress a view.

    Returns:
        `out`.

    Raises:
        CaptureError: not a capture, or one that lacks what a fault works on.
        ConfigError: no fault is switched on.
        ExportError: `out` is not empty.
        FileError: a file is malformed, or the disk refuses.
    """
    check_new(out)
    if config == SensorConfig(seed=config.seed):
        raise ConfigError("No fault is switched on. Choose a --model, or a strength such as --masks 0.1.")
    capture = read_source(source)
    _check_complete(capture, config)
    # Two views at once: the filters leave the other core idle.
    with ThreadPoolExecutor(2) as pool:
        outcomes = {}
        degraded = pool.map(partial(_degrade, capture, out, config), capture.frames.values())
        for name, outcome in zip(capture.frames, degraded, strict=True):
            outcomes[name] = outcome
            notify(Progress(stage=_STAGE, done=len(outcomes), total=len(capture.frames)))
    _link_rest(capture, out)
    record = {"settings": asdict(config), "model": type(config.depth).__name__ if config.depth else "exact"}
    write_json(out / "gt" / _RECORD, record | {"frames": {name: outcome.truth for name, outcome in outcomes.items()}})
    for name in reversed(capture.documents):  # the main one last: until then a reader sees no capture
        write_json(out / name, _document(capture.documents[name], config, outcomes))
    return out


def _check_complete(capture: SourceCapture, config: SensorConfig) -> None:
    where, frames = capture.root / capture.main, capture.frames.values()
    if config.depth is not None and not any(entry.depth_file_path for entry in frames):
        raise CaptureError(
            f"{where}: no frame has depth (depth_file_path). Use --model exact, or a capture with depth."
        )
    if config.depth is not None and capture.shared.depth_kind != "metric":
        kind = capture.shared.depth_kind
        raise CaptureError(f"{where}: its depth is {kind}, not metric. Degrade the capture that it was made from.")
    if config.masks > 0 and not any(_ids_path(capture, entry) for entry in frames):
        raise CaptureError(f"{where}: no frame has ids (instance_file_path). Leave --masks away.")


def _degrade(capture: SourceCapture, out: Path, config: SensorConfig, entry: FrameEntry) -> _DegradedView:
    """Write what belongs to one view."""
    name = zlib.crc32(entry.file_path.encode())
    rngs = [np.random.default_rng([config.seed, name, fault]) for fault in range(5)]
    made = _DegradedView()
    made.changes.update(_degrade_image(capture, out, config.image, entry, rngs[_IMAGE]))
    if entry.depth_file_path is not None:
        outcome = _degrade_depth(capture, out, config, entry, rngs)
        made.changes.update(outcome.changes)
        made.truth.update(outcome.truth)
    if config.pose != PoseFaults():
        exact = np.array(entry.transform_matrix)
        made.truth["transform_matrix"] = entry.transform_matrix
        made.changes["transform_matrix"] = perturb_pose(exact, config.pose, rngs[_POSE]).tolist()
    made.changes.update(_degrade_ids(capture, out, config.masks, entry, rngs[_MASKS]))
    return made


def _degrade_image(
    capture: SourceCapture, out: Path, faults: ImageFaults, entry: FrameEntry, rng: np.random.Generator
) -> dict[str, str]:
    if faults == ImageFaults():
        link(capture.root / entry.file_path, out / entry.file_path)
        return {}
    image = read_image(capture.root / entry.file_path)
    path = Path(entry.file_path)
    path = path if path.suffix.lower() in (".png", ".jpg", ".jpeg") else path.with_suffix(".png")
    write_image(out / path, degrade_image(image, faults, rng))
    return {"file_path": path.as_posix()}


def _degrade_depth(
    capture: SourceCapture, out: Path, config: SensorConfig, entry: FrameEntry, rngs: list[np.random.Generator]
) -> _DegradedView:
    path = Path(entry.depth_file_path or "")
    if config.depth is None:
        link(capture.root / path, out / path)
        return _DegradedView()
    depth = read_depth(capture.root / path, 1.0 / capture.shared.depth_unit_scale_factor).astype(np.float64)
    camera = capture.camera(entry, depth.shape[1], depth.shape[0])
    made = _DegradedView(changes={"depth_file_path": path.with_suffix(".png").as_posix()})
    target = out / path.with_suffix(".png")
    match config.depth:
        case StructuredLight() as model:
            write_depth(target, structured_light_depth(depth, camera, model, rngs[_DEPTH]))
        case Lidar() as model:
            write_depth(target, lidar_depth(depth, model, rngs[_DEPTH]))
        case MonocularDepth() as model:
            stored = monocular_depth(depth, model, rngs[_DEPTH])
            write_png(target, stored.values)
            made.truth.update(scale=stored.scale, offset=stored.offset)
            if model.normals:
                normals_path = (Path("normal") / Path(entry.file_path).name).with_suffix(".png")
                write_normals(out / normals_path, monocular_normals(depth, camera, model, rngs[_NORMALS]))
                made.changes["normal_file_path"] = normals_path.as_posix()
    return made


def _degrade_ids(
    capture: SourceCapture, out: Path, share: float, entry: FrameEntry, rng: np.random.Generator
) -> dict[str, str]:
    path = _ids_path(capture, entry)
    if path is None:
        return {}
    if share == 0:
        link(capture.root / path, out / path)
    else:
        write_ids(out / path, corrupt_masks(read_ids(capture.root / path), share, rng))
    return {"instance_file_path": path.as_posix()}


def _ids_path(capture: SourceCapture, entry: FrameEntry) -> Path | None:
    """The id image that the frame names, or the one of its stem in instance/."""
    if entry.instance_file_path is not None:
        return Path(entry.instance_file_path)
    path = (Path("instance") / Path(entry.file_path).name).with_suffix(".png")
    return path if is_file(capture.root / path) else None


def _link_rest(capture: SourceCapture, out: Path) -> None:
    """Names of the ids, seed points, ground truth."""
    named = ["labels.json"] + ([capture.shared.ply_file_path] if capture.shared.ply_file_path else [])
    rest = [capture.root / name for name in named if is_file(capture.root / name)]
    if is_folder(capture.root / "gt"):
        rest += sorted(path for path in (capture.root / "gt").rglob("*") if path.is_file() and path.name != _RECORD)
    for path in rest:
        link(path, out / path.relative_to(capture.root))


def _document(document: dict[str, Any], config: SensorConfig, outcomes: dict[str, _DegradedView]) -> dict[str, Any]:
    """A transforms file with what has changed."""
    frames = [frame | outcomes[frame["file_path"]].changes for frame in document["frames"]]
    changed = document | {"frames": frames}
    if isinstance(config.depth, MonocularDepth):
        changed |= {"depth_kind": config.depth.kind, "depth_unit_scale_factor": 1 / 65535}
    elif config.depth is not None:
        changed |= {"depth_unit_scale_factor": _MILLIMETRE}
    return changed
