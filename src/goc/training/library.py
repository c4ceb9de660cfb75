"""Prepared shapes on disk: what `goc osc prepare` wrote, read a shape at a time."""

from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from safetensors import safe_open

from goc.errors import TrainError
from goc.files import is_file, read_json
from goc.training.watertight_shape import BAND, WatertightShape

MANIFEST = "manifest.json"
STEPS = 127.0 / BAND
"""Steps of the stored int8 per voxel of signed distance: 127 is the edge of the band."""


class PreparedShape(msgspec.Struct, kw_only=True, frozen=True):
    """A prepared shape, in the manifest."""

    name: str
    split: Literal["train", "val"]
    shard: str
    how: Literal["closed", "carved"]
    """closed: the mesh was closed, so the sign is exact. carved: inside is what no virtual view sees through."""
    origin: tuple[float, float, float]
    voxel: float
    seconds: float = 0.0


class SkippedMesh(msgspec.Struct, kw_only=True, frozen=True):
    """A mesh that was left out, and why."""

    name: str
    why: str


class Manifest(msgspec.Struct, kw_only=True):
    """What a folder of prepared shapes holds."""

    kept: list[PreparedShape] = msgspec.field(default_factory=list)
    dropped: list[SkippedMesh] = msgspec.field(default_factory=list)


@dataclass(frozen=True, eq=False)
class ShapeLibrary:
    """The shapes of one split of a prepared folder; shards stay on disk, mapped."""

    folder: Path
    split: Literal["train", "val"]
    shapes: tuple[PreparedShape, ...] = field(init=False)

    def __post_init__(self) -> None:
        path = self.folder / MANIFEST
        if not is_file(path):
            raise TrainError(f"{path}: not found. Make it with `goc osc prepare MESHES {self.folder}`.")
        kept = read_json(path, Manifest).kept
        object.__setattr__(self, "shapes", tuple(shape for shape in kept if shape.split == self.split))
        if not self.shapes:
            raise TrainError(f"{path}: none of {len(kept)} shapes is of split {self.split}. Prepare some.")

    def __len__(self) -> int:
        return len(self.shapes)

    def __getitem__(self, index: int) -> WatertightShape:
        shape = self.shapes[index]
        path = self.folder / shape.shard
        try:
            with safe_open(path, framework="numpy") as file:
                steps = file.get_tensor(f"{shape.name}/distance")
        except Exception as error:  # safetensors raises its own, the system's and Rust's
            raise TrainError(f"{path}: cannot be read ({error}). Delete it and prepare again.") from error
        return WatertightShape(
            distance=steps.astype(np.float32) * np.float32(shape.voxel / STEPS),
            origin=np.array(shape.origin, np.float64),
            voxel=shape.voxel,
        )


@lru_cache(maxsize=4)
def open_library(folder: Path, split: Literal["train", "val"]) -> ShapeLibrary:
    """The library of one split, cached so that a process opens it once."""
    return ShapeLibrary(folder, split)
