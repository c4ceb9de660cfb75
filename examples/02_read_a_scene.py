"""Read a carved room back: objects, their meshes and splats, and the way into the frame of simulators.

    python examples/02_read_a_scene.py [FOLDER]

FOLDER (default: out/example) is what 01_carve.py wrote. Seconds.
"""

import sys
from pathlib import Path

from goc.files import read_scene
from goc.report import read_report


def main(folder: Path) -> None:
    """Print what stands where in the room, in metres above its floor."""
    scene = read_scene(folder / "carved")
    world = scene.world
    print(f"up is {world.up.round(3).tolist()}, the floor at {world.floor:.2f}, {world.confidence:.0%} sure")
    print(f"{len(scene.splats):,} splats, {len(scene.mesh.faces):,} faces, {len(scene.cameras)} cameras")

    # Everything in a scene is in the capture's world; this matrix leads to z up, metres, floor at 0.
    level = world.level_from_world
    for item in scene.objects:
        surface = item.surface  # closed where it could be closed, else as it was seen
        if surface is None or item.splats is None:
            continue
        placed = surface.mesh.vertices @ level[:3, :3].T + level[:3, 3]
        low, high = placed.min(axis=0), placed.max(axis=0)
        size = " x ".join(f"{side:.2f}" for side in high - low)
        seen = f"{surface.observed.mean():.0%} of its vertices measured, {len(item.splats):,} splats"
        print(f"{item.id} {item.name}: {size} m, stands at {low[2]:.2f} m, {seen}")

    report = read_report(folder / "carved" / "report.json")  # figures and settings of the run
    print(f"{report.config['reconstruct']['iterations']} steps, {report.metrics['held_out_psnr_db']:.1f} dB")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
