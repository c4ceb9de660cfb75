"""The camera as the C++ kernels take it."""

from typing import Any

from torch import Tensor

from goc import _native
from goc.scene.camera import Camera


def native_camera(camera: Camera) -> _native.Camera:
    """Copy a camera's numbers, from whatever device, for kernels: in double, so that none is rounded."""
    return _native.Camera(
        _numbers(camera.focal_px),
        _numbers(camera.centre_px),
        camera.width,
        camera.height,
        _numbers(camera.cam_from_world[:3]),
        _numbers(camera.world_from_cam[:3]),
    )


def _numbers(values: Tensor) -> list[Any]:
    """Quicker by lists than by arrays, for so few."""
    return values.cpu().numpy().tolist()
