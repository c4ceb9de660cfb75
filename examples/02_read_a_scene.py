"""Read what a run wrote: splats with their ids, cameras, the world, and every object with its surfaces.

    python examples/02_read_a_scene.py [FOLDER]

FOLDER (default: out/example) is what 01_carve.py has filled. Seconds.
"""

import sys
from pathlib import Path

import numpy as np

from goc.files import read_scene


def main(folder: Path) -> None:
    """Tell what is in the scene."""
    scene = read_scene(folder / "carved")
    world = scene.world
    print(f"{len(scene.splats):,} splats, {len(scene.cameras)} cameras, {len(scene.mesh.faces):,} faces")
    print(
        f"up is {np.round(world.up, 2)}; a metre is {world.units_per_metre:g} units, {world.confidence:.0%} sure of up"
    )

    for item in scene.objects:
        own = int((scene.labels == item.id).sum())
        closed = "open" if item.solid is None else f"closed, {item.solid.observed.mean():.0%} of its vertices measured"
        print(f"object {item.id}, {item.name}: {own} splats, {closed}")

    # Meshes are in the capture's world; level_from_world makes it z up, metres, floor at 0.
    first = next(item for item in scene.objects if item.solid is not None)
    turn, shift = world.level_from_world[:3, :3], world.level_from_world[:3, 3]
    level = first.solid.mesh.vertices @ turn.T + shift
    print(f"object {first.id} reaches from {level[:, 2].min():.2f} m to {level[:, 2].max():.2f} m above the floor")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
