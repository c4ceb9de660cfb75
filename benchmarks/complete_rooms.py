"""What completion makes of exact depth and ids: `python benchmarks/complete_rooms.py --data ../shared/data/bench`.

Fuses the measured depth of each room (all 170 views, and the 50 of transforms_sparse.json) into objects, completes
them, and prints one line for the open objects and one for the closed ones, in the protocol of goc.evaluation.
"Acc seen" is the accuracy of the surface that is flagged as observed: completion must leave it as good as it was.
"""

import argparse
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from goc.capture import load_capture
from goc.complete import CompleteConfig, complete_objects
from goc.evaluation.metrics import sample_surface, surface_scores
from goc.evaluation.rooms import score_room
from goc.extract import ExtractConfig, extract_objects
from goc.geometry.topology import is_watertight
from goc.scene import ObjectMesh

ROOMS = ("living", "study", "kitchen")
CAPTURES = {"170": "transforms.json", "50": "transforms_sparse.json"}
COLUMNS = ("Acc", "Comp", "CD", "F@5cm", "F@1cm", "NC", "Comp seen", "Comp unseen", "Acc seen", "watertight", "s")


def seen_accuracy(room: Path, objects: tuple[ObjectMesh, ...]) -> float:
    """Mean distance to the truth of surface between observed vertices, mean over objects, metres."""
    found = []
    with np.load(room / "gt" / "points.npz", allow_pickle=False) as truth:
        for item in objects:
            seen = item.observed[item.mesh.faces].all(axis=1)
            if f"p{item.id}" in truth.files and seen.any():
                samples = sample_surface(replace(item.mesh, faces=item.mesh.faces[seen]))
                there = replace(samples, points=truth[f"p{item.id}"], normals=truth[f"n{item.id}"])
                found.append(surface_scores(samples, there).accuracy)
    return float(np.mean(found))


def row(name: str, room: Path, objects: tuple[ObjectMesh, ...], count: int, seconds: float) -> str:
    """One line of the table; an object that could not be closed counts as missing."""
    mean = score_room(room, {item.id: item.mesh for item in objects}).mean()
    closed = sum(is_watertight(item.mesh) for item in objects) / max(1, count)
    cells = [
        name,
        *(f"{mean[key]:.4f}" for key in ("accuracy", "completion", "chamfer")),
        *(f"{mean[key]:.3f}" for key in ("f_score_0.05", "f_score_0.01", "normal_consistency")),
        *(f"{mean[key]:.4f}" for key in ("completion_seen", "completion_unseen")),
        f"{seen_accuracy(room, objects):.4f}",
        f"{closed:.0%}",
        f"{seconds:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Fuse, complete, score, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/bench"))
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=ROOMS)
    parser.add_argument("--views", nargs="+", default=list(CAPTURES), choices=list(CAPTURES))
    parser.add_argument("--methods", nargs="+", default=["hull", "lite"], choices=("hull", "lite", "osc"))
    parser.add_argument("--weights", type=Path, help="of a network, where goc ships none")
    parser.add_argument("--threshold", type=float, default=0.5, help="occupancy that counts as solid")
    arguments = parser.parse_args()
    print("| room, views, method | " + " | ".join(COLUMNS) + " |")
    print("|" + "---|" * (len(COLUMNS) + 1))
    for room in arguments.rooms:
        for views in arguments.views:
            folder = arguments.data / room
            started = time.perf_counter()
            objects = extract_objects(load_capture(folder / CAPTURES[views]), ExtractConfig())
            extracted = time.perf_counter()
            print(row(f"{room}, {views}, observed", folder, objects, len(objects), extracted - started), flush=True)
            for method in arguments.methods:
                weights = None if method == "hull" else arguments.weights
                config = CompleteConfig(method=method, weights=weights, threshold=arguments.threshold)
                began = time.perf_counter()
                done = complete_objects(objects, config)
                seconds = time.perf_counter() - began
                print(row(f"{room}, {views}, {method}", folder, done, len(objects), seconds), flush=True)


if __name__ == "__main__":
    main()
