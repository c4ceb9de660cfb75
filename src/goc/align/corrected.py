"""A capture's frames with corrected cameras and photographs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float, Float64, UInt8
from torch import Tensor

from goc.scene.camera import Camera
from goc.scene.capture import Frame, FrameSource


def corrected_cameras(cameras: Sequence[Camera], poses: Float64[np.ndarray, "v 4 4"]) -> tuple[Camera, ...]:
    """The cameras elsewhere."""
    placed = zip(cameras, torch.from_numpy(poses), strict=True)
    return tuple(replace(camera, world_from_cam=pose.to(camera.world_from_cam.dtype)) for camera, pose in placed)


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedFrames:
    """The views of another source, seen by other cameras, with photographs of one exposure."""

    below: FrameSource
    cameras: tuple[Camera, ...]
    exposure: Float[Tensor, "n 3 2"] | None
    """Gain and offset of each channel; None: photographs stay as they are."""

    def __call__(self, index: int) -> Frame:
        """One view."""
        frame = self.below(index)
        image = frame.image if self.exposure is None else evened(frame.image, self.exposure[index])
        return replace(frame, camera=self.cameras[index], image=image)


def evened(image: UInt8[Tensor, "h w 3"], exposure: Float[Tensor, "3 2"]) -> UInt8[Tensor, "h w 3"]:
    """A photograph as it would be with gain 1 and offset 0; what was too bright or too dark stays so."""
    levels = torch.arange(256, dtype=torch.float64)
    table = ((levels - 255.0 * exposure[:, 1:]) / exposure[:, :1]).round().clamp(0, 255).to(torch.uint8)
    return torch.stack([table[channel][image[..., channel].long()] for channel in range(3)], -1)
