"""A whole scene: what stages 3 to 6 hand on, and what is read back from disk."""

from dataclasses import dataclass, field

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
    """All of them, those of objects included."""
    labels: Int16[Tensor, "n"]
    """Object id of each splat: 0 = room, 1… = objects, UNLABELLED (-1) = never seen."""
    mesh: Mesh
    """Surface of the whole scene with vertex colours."""
    objects: tuple[SceneObject, ...]
    """Ascending ids."""
    cameras: dict[str, Camera]
    """Of every view, by its name."""
    world: World
    metrics: dict[str, float] = field(default_factory=dict[str, float])
    """How the splats were obtained and how well: held-out PSNR in dB, steps."""
