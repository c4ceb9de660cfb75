"""Close a partial scan: points with a gap go in, a watertight mesh comes out.

    python examples/03_complete_a_scan.py [FOLDER]

The scan is a ball that lay on something: its lowest fifth was not seen. FOLDER (default: out/example) gets ball.ply,
whose vertex property `observed` is 1 where there were points and 0 where surface was filled in. Seconds.
"""

import sys
from pathlib import Path

import numpy as np

from goc.complete import ScanConfig, complete_scan
from goc.files import write_mesh
from goc.geometry.topology import is_watertight, signed_volume
from goc.scene import PointCloud


def scanned_ball(count: int) -> PointCloud:
    """Points on the unit ball, without those that nobody saw."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    seen = points[points[:, 2] > -0.6].astype(np.float32)
    return PointCloud(positions=seen, colours=np.full(seen.shape, 200, np.uint8))


def main(folder: Path) -> None:
    """Complete the ball, and write it."""
    scan = scanned_ball(20_000)
    closed = complete_scan(scan, ScanConfig(method="smooth", cells=64))  # left out, the method is chosen for the scan
    write_mesh(folder / "ball.ply", closed.mesh, closed.observed)
    print(f"{len(scan.positions):,} points became {len(closed.mesh.faces):,} faces")
    print(f"watertight: {is_watertight(closed.mesh)}; {closed.observed.mean():.0%} of the vertices measured")
    print(f"volume {signed_volume(closed.mesh):.2f}; the whole ball has {4 / 3 * np.pi:.2f}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/example"))
