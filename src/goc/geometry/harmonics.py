"""Real spherical harmonics up to degree 3, in the sign convention of 3D Gaussian Splatting's files."""

import torch
from jaxtyping import Float
from torch import Tensor

_BAND_1 = 0.4886025119029199
_BAND_2 = (1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396)
_BAND_3 = (
    -0.5900435899266435,
    2.890611442640554,
    -0.4570457994644658,
    0.3731763325901154,
    -0.4570457994644658,
    1.445305721320277,
    -0.5900435899266435,
)
BAND_0 = 0.28209479177387814
"""The constant harmonic, 1 / (2 √π)."""


def harmonics(directions: Float[Tensor, "n 3"], degree: int) -> Float[Tensor, "n k"]:
    """Y_0 … Y_k towards unit directions, k = (degree + 1)² and degree ≤ 3."""
    columns = [torch.full_like(directions[:, 0], BAND_0)]
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    if degree >= 1:
        columns += [-_BAND_1 * y, _BAND_1 * z, -_BAND_1 * x]
    if degree >= 2:
        quadratic = (x * y, y * z, 2 * zz - xx - yy, x * z, xx - yy)
        columns += [c * polynomial for c, polynomial in zip(_BAND_2, quadratic, strict=True)]
    if degree >= 3:
        cubic = (
            y * (3 * xx - yy),
            x * y * z,
            y * (4 * zz - xx - yy),
            z * (2 * zz - 3 * xx - 3 * yy),
            x * (4 * zz - xx - yy),
            z * (xx - yy),
            x * (xx - 3 * yy),
        )
        columns += [c * polynomial for c, polynomial in zip(_BAND_3, cubic, strict=True)]
    return torch.stack(columns, -1)


def colours_towards(
    sh: Float[Tensor, "n k 3"], means: Float[Tensor, "n 3"], eye: Float[Tensor, "3"]
) -> Float[Tensor, "n 3"]:
    """Colour of each splat seen from `eye`, max(0, 0.5 + Σ sh·Y); no gradient reaches the means."""
    if sh.shape[1] == 1:
        return (0.5 + BAND_0 * sh[:, 0]).clamp_min(0.0)
    directions = torch.nn.functional.normalize(means.detach() - eye, dim=-1)
    basis = harmonics(directions, round(sh.shape[1] ** 0.5) - 1)
    return (0.5 + torch.einsum("nk,nkc->nc", basis, sh)).clamp_min(0.0)
