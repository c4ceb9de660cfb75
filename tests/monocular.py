"""The box room with monocular depth: stored up to a scale and an offset of each view, and what is known of both."""

import numpy as np
import torch

import captures
from goc.capture import CaptureConfig, load_capture
from goc.files import write_depth
from goc.scene import Capture, CoarseDepth

LINES = [(k, b) for k, b in zip(np.geomspace(0.5, 2.0, 8), np.linspace(-0.1, 0.5, 8), strict=True)]
"""k and b of each view."""


def written(folder, kind: str, change=captures.keep) -> Capture:
    """The box room with depth stored up to k and b of each view: D = (z - b) / k, or (1/z - b) / k."""

    def all_changes(document):
        document |= {"depth_kind": kind, "depth_unit_scale_factor": 0.0001}
        change(document)

    captures.write_nerfstudio(folder, views=8, change=all_changes)
    for view, pose in enumerate(captures.poses(8)):
        depth = captures.see(pose).depth
        k, b = line(view, kind)
        stored = ((depth if kind == "affine" else 1.0 / depth) - b) / k
        write_depth(folder / f"depth/{view:04d}.png", 10.0 * stored)
    return load_capture(folder, CaptureConfig(units_per_metre=1.0))


def line(view: int, kind: str) -> tuple[float, float]:
    k, b = LINES[view]
    return (k, b) if kind == "affine" else (k, -0.3 * b - 0.05)


def truth(view: int) -> torch.Tensor:
    return torch.from_numpy(captures.see(captures.poses(8)[view]).depth).float()


def known(capture: Capture, views=range(8)) -> dict[int, CoarseDepth]:
    """What stereo would say: true depth of every fourth pixel, a fifth of it wrong."""
    found = {}
    for view in views:
        depth = truth(view)[2::4, 2::4].clone()
        wrong = torch.rand(depth.shape, generator=torch.Generator().manual_seed(view)) < 0.2
        depth[wrong] = 0.7
        found[view] = CoarseDepth(camera=capture.cameras[view].resized(16, 12), depth=depth)
    return found
