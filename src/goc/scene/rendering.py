"""What a view of the splats shows."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendering:
    """One rendered view; every image has the camera's height and width."""

    colour: Float[Tensor, "h w 3"]
    """sRGB in 0…1 over a black background."""
    alpha: Float[Tensor, "h w"]
    depth: Float[Tensor, "h w"]
    """Expected z of the splats' centres, Eq. (2), scene units; 0 where alpha is 0."""
    plane_depth: Float[Tensor, "h w"]
    """z where the ray meets the blended splat plane, scene units; NaN where there is none."""
    normals: Float[Tensor, "h w 3"]
    """Blended splat normals, camera axes, facing the camera; unit where alpha > 0."""
