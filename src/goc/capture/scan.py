"""A scanned surface with ids, seen by the views of a capture that has no depth or ids of its own."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64, Int16, Int64

from goc.errors import CaptureError
from goc.files import read_mesh
from goc.geometry.raycast import TriangleScene
from goc.scene import UNLABELLED, Camera, Frame, FrameSource


@dataclass(frozen=True, eq=False)
class Scan:
    """A mesh in the world of the poses."""

    path: Path
    """PLY; read when the first view is."""
    ids: Int16[np.ndarray, "v"] | None = None
    """Of its vertices; None where nobody labelled it."""
    depth: bool = True
    """Whether views without depth see theirs on it."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What was taken off the poses' positions."""

    def wanted(self, use_depth: bool, use_ids: bool, offset: tuple[float, float, float]) -> "Scan | None":
        """The scan with what the user does not want left out, for poses without their offset; None where all is."""
        kept = replace(self, depth=self.depth and use_depth, ids=self.ids if use_ids else None, offset=offset)
        return kept if kept.depth or kept.ids is not None else None


@dataclass(frozen=True, kw_only=True, eq=False)
class WithScan:
    """The views of another source, with what they see of a scan."""

    below: FrameSource
    scan: Scan

    def __call__(self, index: int) -> Frame:
        """Cast a ray through every pixel.

        Raises:
            FileError: the mesh is missing or damaged.
            CaptureError: it has another number of vertices than labels.
        """
        frame = self.below(index)
        depth, corner = _seen(_loaded(self.scan.path), frame.camera, self.scan.offset)
        shape = (frame.camera.height, frame.camera.width)
        shown = np.ones(shape, bool) if frame.valid is None else frame.valid.numpy()
        if self.scan.depth and frame.depth is None:
            metres = np.where(np.isfinite(depth.reshape(shape)) & shown, depth.reshape(shape), np.nan)
            frame = replace(frame, depth=torch.from_numpy(metres.astype(np.float32)))
        if self.scan.ids is not None and frame.ids is None:
            if corner.max(initial=-1) >= len(self.scan.ids):
                text = f"{self.scan.path}: more vertices than the {len(self.scan.ids)} of its labels"
                raise CaptureError(f"{text}. Download both again.")
            ids = np.where(corner >= 0, self.scan.ids[corner], UNLABELLED).reshape(shape)
            frame = replace(frame, ids=torch.from_numpy(np.where(shown, ids, UNLABELLED).astype(np.int16)))
        return frame


@lru_cache(maxsize=1)  # a laser scan has millions of triangles, and every view sees the same one
def _loaded(path: Path) -> TriangleScene:
    mesh = read_mesh(path)
    return TriangleScene(mesh.vertices, mesh.faces)


def _seen(
    scene: TriangleScene, camera: Camera, offset: tuple[float, float, float]
) -> tuple[Float64[np.ndarray, "p"], Int64[np.ndarray, "p"]]:
    """Z along the axis through each pixel, infinity for none; and the corner nearest to what is hit, -1 for none."""
    pose = camera.world_from_cam.double().numpy()
    directions = camera.rays().double().numpy().reshape(-1, 3) @ pose[:3, :3].T
    hits = scene.closest_hit(np.broadcast_to(pose[:3, 3] + offset, directions.shape), directions)
    nearest = np.take_along_axis(scene.faces[hits.triangle], hits.barycentrics.argmax(-1)[:, None], 1)[:, 0]
    return hits.t, np.where(hits.found, nearest, -1).astype(np.int64)
