"""Errors of estimated camera poses: each view is turned and shifted a little on its own."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from goc.settings import Range, Settings


@dataclass(frozen=True, kw_only=True)
class PoseFaults(Settings):
    """Errors of camera poses; 0 switches one off."""

    rotation_deg: Annotated[float, Range(least=0, most=90)] = 0.0
    """Root mean square of the angle by which a camera is turned, about a random axis."""
    translation_m: Annotated[float, Range(least=0, most=100)] = 0.0
    """Root mean square of the distance by which a camera is shifted."""


def perturb_pose(
    world_from_cam: Float[np.ndarray, "4 4"], config: PoseFaults, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """A pose turned about its own centre and shifted; rotation and shift vectors are normal and isotropic."""
    turn, shift = rng.standard_normal((2, 3)) / np.sqrt(3)
    noisy = world_from_cam.copy()
    turned = Rotation.from_rotvec(np.radians(config.rotation_deg) * turn).as_matrix()
    noisy[:3, :3] = noisy[:3, :3] @ turned
    noisy[:3, 3] += config.translation_m * shift
    return noisy
