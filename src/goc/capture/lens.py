"""The intrinsics of stored pixels, of every lens that goc knows."""

import math
from dataclasses import dataclass, replace
from typing import Literal

Projection = Literal["perspective", "fisheye", "fov", "division", "eucm", "equirectangular"]
"""How a lens brings directions onto its plane, before distortion. rho is the distance from the axis at depth 1, theta
the angle from the axis.

perspective      rho                                                   (Brown 1966, OpenCV)
fisheye          theta                                                 (Kannala and Brandt 2006, OpenCV's fisheye)
fov              atan(2 rho tan(shape / 2)) / shape                    (Devernay and Faugeras 2001)
division         2 rho / (1 + sqrt(1 - 4 shape rho²))                  (Fitzgibbon 2001)
eucm             rho / (alpha sqrt(beta rho² + 1) + 1 - alpha)         (Khomutenko et al. 2016)
equirectangular  longitude and latitude, radians
"""


@dataclass(frozen=True)
class Lens:
    """Intrinsics of the stored pixels; pixel (0, 0) is centred at (0.5, 0.5).

    On the plane of its projection a lens distorts by the factor (1 + k1 r² + k2 r⁴ + …) / (1 + d1 r² + d2 r⁴ + …), and
    shifts by OpenCV's tangential p1, p2 and thin prism s1 … s4: s1 r² + s2 r⁴ across, s3 r² + s4 r⁴ down.
    """

    width: int
    height: int
    focal_px: tuple[float, float]
    """Pixels in a unit of the plane: for fisheyes and equirectangular images, in a radian."""
    centre_px: tuple[float, float]
    radial: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    """k1, k2, …: as many as the lens has."""
    tangential: tuple[float, float] = (0.0, 0.0)
    projection: Projection = "perspective"
    shape: tuple[float, ...] = ()
    """What the projection needs: fov the angle, division k, eucm alpha and beta; nothing for others."""
    denominator: tuple[float, ...] = ()
    """d1, d2, …"""
    prism: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    bent_twice: bool = False
    """Tangential and prism shifts are those of the place after radial distortion (Aria), not before."""
    margin_px: int = 0
    """Width of a border of the image that shows nothing, for example black after a phone's own rectification."""
    circle_px: float | None = None
    """Radius round the centre beyond which a fisheye's image shows nothing."""
    turn: tuple[float, ...] | None = None
    """Rotation lens_from_cam, 9 numbers by rows: the pinhole view looks elsewhere than along the lens's axis."""

    @property
    def is_pinhole(self) -> bool:
        """Whether straight lines stay straight, and every stored pixel shows something."""
        bent = any((*self.radial, *self.tangential, *self.denominator, *self.prism))
        return not (self.projection != "perspective" or bent or self.margin_px or self.circle_px or self.turn)

    def resized(self, width: int, height: int) -> "Lens":
        """The same lens on a raster of another size."""
        across, down = width / self.width, height / self.height
        return replace(
            self,
            width=width,
            height=height,
            focal_px=(self.focal_px[0] * across, self.focal_px[1] * down),
            centre_px=(self.centre_px[0] * across, self.centre_px[1] * down),
            margin_px=math.ceil(self.margin_px * max(across, down)),
            circle_px=None if self.circle_px is None else self.circle_px * min(across, down),
        )


def equirectangular(width: int, height: int) -> Lens:
    """The lens of a panorama of the whole sphere, the middle of the image straight ahead."""
    focal = (width / (2 * math.pi), height / math.pi)
    return Lens(width, height, focal, (width / 2, height / 2), projection="equirectangular")
