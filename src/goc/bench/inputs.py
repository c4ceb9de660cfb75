"""What the runs work on: rooms made for the benchmark, and spoiled copies of rooms."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from goc.bench.config import BenchConfig
from goc.bench.plan import MADE, Run
from goc.events import Listener
from goc.files import is_file
from goc.synth.captures import RoomConfig, make_room_capture
from goc.synth.sensor import MODELS, MonocularDepth, SensorConfig, degrade_capture

_ROOM = RoomConfig(views=170, sparse_views=50, width=384, height=384, objects=10)
"""The shape of the paper's rooms."""
_SPOILED_MASKS = 0.1
_FAULTS = {
    "kinect": SensorConfig(depth=MODELS["kinect"]),
    "affine": SensorConfig(depth=MonocularDepth(waves=0.0)),
    "monocular": SensorConfig(depth=MODELS["monocular"]),
    "masks": SensorConfig(masks=_SPOILED_MASKS),
}
"""Sensor of each input; the others take a room as it is."""


def make_rooms(config: BenchConfig, folder: Path, notify: Listener) -> dict[str, Path]:
    """Synthetic rooms by name: the n-th is always the same one."""
    rooms = {f"{MADE}{seed}": folder / f"{MADE}{seed}" for seed in range(config.synth_rooms)}
    for seed, room in enumerate(rooms.values()):
        _made(room, lambda new, seed=seed: make_room_capture(new, replace(_ROOM, seed=seed), notify))
    return rooms


def make_input(room: Path, run: Run, folder: Path, notify: Listener) -> Path:
    """The capture that a run is given: the room itself, or a copy that a sensor spoiled."""
    faults = _FAULTS.get(run.input)
    if faults is None:
        return room
    copy = folder / f"{run.room}-{run.input}"
    _made(copy, lambda new: degrade_capture(room, new, faults, notify))
    return copy


def _made(capture: Path, make: Callable[[Path], object]) -> None:
    """Make a capture unless it is there; under another name first, so that one that is there is whole."""
    if is_file(capture / "transforms.json"):
        return
    making = capture.with_name(f".{capture.name}.making")
    shutil.rmtree(making, ignore_errors=True)
    capture.parent.mkdir(parents=True, exist_ok=True)
    make(making)
    making.rename(capture)
