"""The camera as the C++ kernels take it."""

from goc import _native
from goc.scene.camera import Camera


def native_camera(camera: Camera) -> _native.Camera:
    """Copy a camera's numbers, from whatever device, for kernels: in double, so that none is rounded."""
    return _native.Camera(
        camera.focal_px.tolist(),
        camera.centre_px.tolist(),
        camera.width,
        camera.height,
        camera.cam_from_world[:3].tolist(),
        camera.world_from_cam[:3].tolist(),
    )
