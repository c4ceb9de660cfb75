"""Score `goc complete` on bare scans: `python benchmarks/scans.py MESHES [--split val] [--count 8] [--methods auto]`.

MESHES is a folder of meshes with an objects.csv (file, name, split, watertight). Each closed mesh is scanned four ways,
as points without normals, with noise of 0.3 % of its longest side: one depth image in the camera's frame, one in an
upright frame, three views merged, and one half of the surface. Nothing else is told. Lengths are shares of the longest
side; `unseen` is F over the part of the true surface further than 1.5 % from every point, and over what was made there.
The last table compares each method with `convex` on the same scans, if that is among the methods. `--own` scans four
made things instead (mug, bowl, can, chair), which need no MESHES.
"""

import argparse
import csv
import sys
import zlib
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

from goc.complete import ScanConfig, complete_scan
from goc.errors import GocError
from goc.evaluation.metrics import sample_surface
from goc.files.any_mesh import read_any_mesh
from goc.geometry.raycast import TriangleScene
from goc.scene import Mesh, PointCloud

KINDS = ("camera frame", "upright", "three views", "half")
SIDE, NOISE, NEAR, UNSEEN, SAMPLES, PLACES = 150, 0.003, 0.02, 0.015, 20_000, 40_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A scan and the mesh that it was taken of, in one frame."""

    points: Float[np.ndarray, "p 3"]
    mesh: Mesh
    longest: float


def scanned(mesh: Mesh, kind: str, random: np.random.Generator) -> Scan:
    """A mesh, turned about z at random, and scanned."""
    yaw = random.uniform(0, 2 * np.pi)
    c, s = np.cos(yaw), np.sin(yaw)
    vertices = mesh.vertices.astype(np.float64) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    vertices -= (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    longest = float(np.ptp(vertices, axis=0).max())
    thing = Mesh(vertices=vertices.astype(np.float32), faces=mesh.faces)
    scene = TriangleScene(thing.vertices, thing.faces)
    start, turn = random.uniform(0, 2 * np.pi), random.uniform(0.6, 1.2)
    if kind == "half":
        points = sample_surface(thing, 24_000, 3).points
        points = points + random.normal(0, NOISE * longest, points.shape)
        return Scan(points=points[points[:, 0] > 0], mesh=thing, longest=longest)
    views = [_view(scene, longest, start + turn * k, random) for k in range(3 if kind == "three views" else 1)]
    points = np.concatenate([points for points, _, _ in views])
    if kind == "camera frame":
        _, eye, axes = views[0]
        points, vertices = (points - eye) @ axes.T, (vertices - eye) @ axes.T
    return Scan(points=points, mesh=Mesh(vertices=vertices.astype(np.float32), faces=mesh.faces), longest=longest)


def _view(
    scene: TriangleScene, longest: float, azimuth: float, random: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points of one depth image with noise along the rays; the eye, and the camera's axes as rows."""
    height, distance = np.radians(random.uniform(15, 45)), random.uniform(2, 4)
    way = np.array([np.cos(azimuth) * np.cos(height), np.sin(azimuth) * np.cos(height), np.sin(height)])
    eye = distance * longest * way
    right = np.cross(-way, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(-way, right), -way])
    steps = np.linspace(-0.9, 0.9, SIDE) / distance
    rays = np.stack([axis.ravel() for axis in np.meshgrid(steps, steps)] + [np.ones(SIDE**2)], -1) @ axes
    hits = scene.closest_hit(np.broadcast_to(eye, rays.shape), rays)
    depth = hits.t[hits.found] + random.normal(0, NOISE * longest, int(hits.found.sum()))
    return eye + rays[hits.found] * depth[:, None], eye, axes


def scores(scan: Scan, made: Mesh | None) -> tuple[float, float, float]:
    """IoU, F at 2 %, and F at 2 % over what no point was near; zeros where nothing was made."""
    if made is None:
        return 0.0, 0.0, 0.0
    truth, found = sample_surface(scan.mesh, SAMPLES, 1), sample_surface(made, SAMPLES)
    limit = NEAR * scan.longest
    off, at = cKDTree(truth.points).query(found.points)
    missed = cKDTree(found.points).query(truth.points)[0]
    unseen = cKDTree(scan.points).query(truth.points)[0] > UNSEEN * scan.longest
    return (
        _overlap(scan.mesh, made),
        _f(off < limit, missed < limit),
        _f(off[unseen[at]] < limit, missed[unseen] < limit),
    )


def _f(precise: np.ndarray, recalled: np.ndarray) -> float:
    precision, recall = (float(hits.mean()) if len(hits) else 0.0 for hits in (precise, recalled))
    return 2 * precision * recall / (precision + recall) if precision + recall else 0.0


def _overlap(first: Mesh, second: Mesh) -> float:
    low = np.minimum(first.vertices.min(axis=0), second.vertices.min(axis=0))
    high = np.maximum(first.vertices.max(axis=0), second.vertices.max(axis=0))
    places = np.random.default_rng(0).uniform(low, high, (PLACES, 3))
    inside = [TriangleScene(mesh.vertices, mesh.faces).winding(places) != 0 for mesh in (first, second)]
    return float((inside[0] & inside[1]).sum() / max((inside[0] | inside[1]).sum(), 1))


def chosen(folder: Path, split: str, count: int) -> Iterator[tuple[str, Mesh]]:
    """Closed meshes of a split, a few of each source, the same every time."""
    with (folder / "objects.csv").open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["split"] == split and row["watertight"] == "True"]
    order = sorted(rows, key=lambda row: zlib.crc32(row["name"].encode()))
    taken: dict[str, int] = defaultdict(int)
    picked = []
    for row in order:
        source = row.get("source", "")
        if taken[source] < max(2, count // 4):
            taken[source] += 1
            picked.append(row)
    for row in picked[:count]:
        yield row["name"], read_any_mesh(folder / row["file"], weld=True)


def own_things() -> Iterator[tuple[str, Mesh]]:
    """A mug, a bowl, a can and a chair, closed, from cylinders, spheres and boxes."""
    lathe = trimesh.creation.revolve
    cup = [[0, 0], [0.4, 0], [0.4, 1], [0.32, 1], [0.32, 0.1], [0, 0.1]]
    angles = np.linspace(0, np.pi / 2, 24)
    outer, inner = ([[r * np.sin(a), 0.5 - r * np.cos(a)] for a in angles] for r in (0.5, 0.42))
    handle = trimesh.creation.torus(0.22, 0.05)
    handle.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    handle.apply_translation([0.45, 0, 0.5])
    bars = [((0.5, 0.5, 0.06), (0, 0, 0)), ((0.06, 0.5, 0.54), (0.22, 0, 0.27))]
    bars += [((0.06, 0.06, 0.5), (x, y, -0.25)) for x in (-0.22, 0.22) for y in (-0.22, 0.22)]
    boxes = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(place)) for size, place in bars]
    made = {
        "mug": [lathe(np.array(cup)), handle],
        "bowl": [lathe(np.array(outer + inner[::-1]))],
        "can": [trimesh.creation.cylinder(0.25, 1.0)],
        "chair": boxes,
    }
    for name, parts in made.items():
        whole = trimesh.util.concatenate(parts)
        yield name, Mesh(vertices=whole.vertices.astype(np.float32), faces=whole.faces.astype(np.int32))


def main(words: list[str]) -> None:
    """Scan, complete, score, and print a line a case and the means."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", type=Path, nargs="?")
    parser.add_argument("--own", action="store_true")
    parser.add_argument("--split", default="val")
    parser.add_argument("--count", type=int, default=8)
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), choices=KINDS)
    parser.add_argument("--methods", nargs="+", default=["auto"])
    parser.add_argument("--cells", type=int, default=128)
    given = parser.parse_args(words)
    found: dict[tuple[str, str], list[tuple[float, float, float]]] = defaultdict(list)
    if given.meshes is None and not given.own:
        parser.error("give MESHES, or --own")
    for name, mesh in own_things() if given.own else chosen(given.meshes, given.split, given.count):
        for kind in given.kinds:
            scan = scanned(mesh, kind, np.random.default_rng([zlib.crc32(name.encode()), KINDS.index(kind)]))
            cloud = PointCloud(
                positions=scan.points.astype(np.float32), colours=np.full(scan.points.shape, 128, np.uint8)
            )
            for method in given.methods:
                try:
                    made, how = complete_scan(cloud, ScanConfig(method=method, cells=given.cells)), ""
                except GocError as error:
                    made, how = None, str(error)
                score = scores(scan, None if made is None else made.mesh)
                found[kind, method].append(score)
                how = how if made is None else f"{made.method}; {'; '.join(made.assumed)}"
                print(f"{name:28} {kind:13} {method:7}", *(f"{value:.3f}" for value in score), how, flush=True)
    print("\n| scan | method | n | IoU | F@2% | F@2% unseen |\n|---|---|---|---|---|---|")
    for (kind, method), rows in found.items():
        means = " | ".join(f"{value:.3f}" for value in np.mean(rows, axis=0))
        print(f"| {kind} | {method} | {len(rows)} | {means} |")
    print("\n| scan | method | F below convex's by more than 0.01 |\n|---|---|---|")
    for (kind, method), rows in found.items():
        if method != "convex" and (kind, "convex") in found:
            pairs = zip(rows, found[kind, "convex"], strict=True)
            print(f"| {kind} | {method} | {sum(row[1] < hull[1] - 0.01 for row, hull in pairs)} of {len(rows)} |")


if __name__ == "__main__":
    main(sys.argv[1:])
