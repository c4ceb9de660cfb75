"""A whole scene: passed from stage to stage, written to disk, and read back from there."""

from dataclasses import dataclass, field
from typing import Any

from jaxtyping import Int16
from torch import Tensor

from goc.scene.camera import Camera
from goc.scene.gaussians import Gaussians
from goc.scene.mesh import Mesh
from goc.scene.object import SceneObject
from goc.scene.world import World


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Room and objects, in the capture's world and units."""

    splats: Gaussians
    """All splats of the scene, those of objects included."""
    labels: Int16[Tensor, "n"]
    """Object id of each splat: 0 = room, 1… = objects, UNLABELLED (-1) = never seen."""
    mesh: Mesh
    """Surface of the whole scene with vertex colours."""
    objects: tuple[SceneObject, ...]
    """Ascending ids."""
    cameras: dict[str, Camera]
    """Camera of every view, by the name of the view."""
    world: World
    """Up, floor and units."""
    metrics: dict[str, float] = field(default_factory=dict[str, float])
    """Figures of the reconstruction by name, such as steps and held-out PSNR in dB."""
    settings: dict[str, Any] = field(default_factory=dict[str, Any])
    """Every setting of the run that made the scene, as JSON has them; empty where no run did."""
