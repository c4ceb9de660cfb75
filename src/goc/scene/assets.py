"""What a carve hands over: room and objects, each with splats and mesh."""

from dataclasses import dataclass

from goc.scene.mesh import Mesh, ObjectMesh
from goc.scene.reconstruction import Reconstruction


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneAssets:
    """The whole scene and its parts, in the capture's world and units."""

    reconstruction: Reconstruction
    scene: Mesh
    """The whole scene's surface with vertex colours."""
    objects: tuple[ObjectMesh, ...]
    """Measured surface of each object, ascending ids."""
    completed: tuple[ObjectMesh, ...] = ()
    """Closed surface of the objects that could be completed, ascending ids; each has an open one in `objects`."""
    units_per_metre: float
    """Scene units in one metre."""
    metric: bool
    """The unit is known, not guessed."""
