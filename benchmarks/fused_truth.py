"""What exact depth and ids give without splats: `python benchmarks/fused_truth.py --data ../shared/data/bench`.

Fuses the measured depth of each room (all 170 views, and the 50 of transforms_sparse.json) and prints the table "what
perfect depth gives without completion", in the protocol of goc.evaluation: the bar that rendered depth is held against.
`--noise` adds 5 mm of noise to depth, flying pixels at silhouettes and ids that slip by a pixel or two.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy import ndimage

from goc.capture import load_capture
from goc.evaluation.rooms import score_room
from goc.extract import ExtractConfig, extract_objects, fuse_scene
from goc.scene import Capture, Frame

ROOMS = ("living", "study", "kitchen")
CAPTURES = {"170": "transforms.json", "50": "transforms_sparse.json"}


def spoiled(capture: Capture) -> Capture:
    """The capture with depth and ids as a rendering or a sensor might give them; the same on every look."""
    load: Callable[[int], Frame] = capture.load

    def noisy(index: int) -> Frame:
        frame, random = load(index), np.random.default_rng(index)
        assert frame.depth is not None and frame.ids is not None
        depth, ids = frame.depth.numpy(), frame.ids.numpy()
        rows, columns = np.indices(depth.shape)
        smooth = ndimage.gaussian_filter(random.standard_normal((3, *depth.shape)), (0, 4, 4))
        smooth /= smooth.std()
        shaken = depth + 0.0035 * (smooth[0] + random.standard_normal(depth.shape))
        blurred = ndimage.uniform_filter(np.nan_to_num(depth, nan=3.0), 3)
        flying = (np.abs(blurred - depth) > 0.03) & (random.random(depth.shape) < 0.7)
        slipped = ids[
            np.clip(np.rint(rows + smooth[1]), 0, depth.shape[0] - 1).astype(int),
            np.clip(np.rint(columns + smooth[2]), 0, depth.shape[1] - 1).astype(int),
        ]
        shown = np.where(flying, blurred, shaken).astype(np.float32)
        return replace(frame, depth=torch.from_numpy(shown), ids=torch.from_numpy(slipped))

    return replace(capture, load=noisy)


def row(name: str, capture: Capture, room: Path) -> str:
    """One line of the table."""
    start = time.perf_counter()
    objects = {found.id: found.mesh for found in extract_objects(capture, ExtractConfig())}
    scene = fuse_scene(capture, ExtractConfig())
    seconds = time.perf_counter() - start
    scores = score_room(room, objects, scene)
    mean = scores.mean()
    assert scores.scene is not None
    cells = [
        name,
        *(f"{mean[key]:.4f}" for key in ("accuracy", "completion", "chamfer")),
        *(f"{mean[key]:.3f}" for key in ("f_score_0.05", "f_score_0.01", "normal_consistency")),
        *(f"{mean[key]:.4f}" for key in ("completion_seen", "completion_unseen")),
        f"{scores.scene.f_score[0.05]:.3f}",
        f"{seconds:.0f}",
    ]
    return "| " + " | ".join(cells) + " |"


def main() -> None:
    """Fuse, score, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data/bench"))
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), choices=ROOMS)
    parser.add_argument("--views", nargs="+", default=list(CAPTURES), choices=list(CAPTURES))
    parser.add_argument("--noise", action="store_true", help="spoil depth and ids")
    arguments = parser.parse_args()
    print("| room, views | Acc | Comp | CD | F@5cm | F@1cm | NC | Comp seen | Comp unseen | scene F@5cm | s |")
    print("|" + "---|" * 11)
    for room in arguments.rooms:
        for views in arguments.views:
            capture = load_capture(arguments.data / room / CAPTURES[views])
            capture = spoiled(capture) if arguments.noise else capture
            print(row(f"{room}, {views}", capture, arguments.data / room), flush=True)


if __name__ == "__main__":
    main()
