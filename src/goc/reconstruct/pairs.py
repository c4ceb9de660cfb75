"""Which views L_pho and L_geo compare."""

from collections.abc import Sequence
from dataclasses import dataclass

from goc.geometry.neighbours import PairLimits, neighbour_views
from goc.reconstruct.config import ReconstructConfig
from goc.scene.camera import Camera
from goc.scene.capture import Capture

_DEPTHS_M = (0.5, 1.0, 2.0, 4.0)
"""Where the surfaces of a room are, metres from a camera: there the frusta of neighbours must overlap."""

_MEMORY_BYTES = 256 * 2**20
"""Most that remembered depths may take."""


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """What each view may be compared with."""

    neighbours: dict[int, tuple[int, ...]]
    stride: int
    """Every how many pixels a depth is remembered, odd."""


def view_pairs(capture: Capture, views: list[int], config: ReconstructConfig) -> Pairs | None:
    """Neighbours of the training views among themselves; None where no weight asks for them."""
    if not (config.losses.photometric or config.losses.geometric):
        return None
    chosen, units_per_metre = config.losses.multiview, capture.units_per_metre
    limits = PairLimits(
        max_angle_deg=chosen.max_angle_deg,
        min_baseline=chosen.min_baseline * units_per_metre,
        max_baseline=chosen.max_baseline * units_per_metre,
        depths=tuple(depth * units_per_metre for depth in _DEPTHS_M),
    )
    return Pairs(
        neighbours=neighbour_views(capture.cameras, views, chosen.neighbours, limits),
        stride=memory_stride([capture.cameras[view] for view in views]),
    )


def memory_stride(cameras: Sequence[Camera], budget: int = _MEMORY_BYTES) -> int:
    """The finest odd stride at which half-precision depths of all views fit into the budget, bytes."""
    pixels = sum(camera.width * camera.height for camera in cameras)
    stride = 1
    while 2 * pixels > budget * stride**2:
        stride += 2
    return stride
