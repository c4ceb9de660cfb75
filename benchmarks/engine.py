"""Time the engine, one training iteration and label votes: `python benchmarks/engine.py [--json FILE]`.

Scene: 60,000 splats on the surfaces of a box room, all in view of a 384×384 camera, 8 channels. Figures are medians.
Runs once for each instruction set. Absolute times drift from machine to machine: a float32 matrix product on as many
threads as the engine has, measured in the same run, says what the machine can do, and so the arithmetic floor.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from goc import _native
from goc.geometry.native_camera import native_camera
from goc.geometry.rotations import quats_towards
from goc.raster import rasterize
from goc.reconstruct.labels import votes_of_view
from goc.scene import Camera, Capture, Frame, Gaussians, StoredFrames

SIDE, FOCAL = 384, 295.65
IDS = 20
"""Objects that are voted for."""


def camera() -> Camera:
    """Looks along +z from the origin."""
    return Camera(
        focal_px=torch.tensor([FOCAL, FOCAL]),
        centre_px=torch.tensor([SIDE / 2, SIDE / 2]),
        width=SIDE,
        height=SIDE,
        world_from_cam=torch.eye(4),
    )


def surface_splats(count: int, generator: torch.Generator) -> Gaussians:
    """Discs on four walls and a back wall, spread evenly over the pixels: a room seen from its middle."""
    pixels = torch.rand(count, 2, generator=generator) * SIDE
    rays = torch.cat([(pixels - SIDE / 2) / FOCAL, torch.ones(count, 1)], 1)
    # Distance to the box |x| ≤ 1.5, |y| ≤ 1.3, z ≤ 3.5.
    hits = torch.stack([1.5 / rays[:, 0].abs(), 1.3 / rays[:, 1].abs(), torch.full((count,), 3.5)], 1)
    depth, wall = hits.min(1)
    normals = torch.zeros(count, 3)
    normals[torch.arange(count), wall] = -1.0
    width = 0.7 * depth / FOCAL * SIDE / count**0.5
    return Gaussians(
        means=rays * depth[:, None],
        quats=quats_towards(normals),
        log_scales=torch.stack([width, width, 0.15 * width], 1).log(),
        opacity_logits=torch.randn(count, generator=generator) + 1.4,
        sh=torch.zeros(count, 4, 3),
    )


def median_ms(action: Callable[[], object], repeats: int = 40) -> float:
    """Median wall time in milliseconds, after two warm-up calls."""
    times = []
    for turn in range(repeats + 2):
        start = time.perf_counter()
        action()
        if turn >= 2:
            times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def engine_times(splats: int, channels: int) -> tuple[float, float]:
    """Forward and backward of one view, milliseconds."""
    gaussians = surface_splats(splats, torch.Generator().manual_seed(0))
    names = ("means", "quats", "log_scales", "opacity_logits")
    gaussians = replace(gaussians, **{name: getattr(gaussians, name).requires_grad_() for name in names})
    values = torch.rand(splats, channels).requires_grad_()
    view = camera()
    upstream = (torch.rand(channels, SIDE, SIDE).permute(1, 2, 0), torch.rand(SIDE, SIDE))
    leaves = [values, *(getattr(gaussians, name) for name in names)]

    def step() -> None:
        for leaf in leaves:
            leaf.grad = None  # as an optimiser leaves it: nothing to add up
        torch.autograd.backward(rasterize(gaussians, view, values), upstream)

    forward, both = median_ms(lambda: rasterize(gaussians, view, values)), median_ms(step)
    return forward, both - forward


def votes_ms(splats: int) -> float:
    """The votes of one view with 20 ids, which label the splats once after the training: a forward and a backward."""
    gaussians = surface_splats(splats, torch.Generator().manual_seed(0))
    ids = (torch.arange(SIDE)[:, None] // 80 * 4 + torch.arange(SIDE) // 100).short()
    return median_ms(lambda: votes_of_view(gaussians, camera(), ids, list(range(IDS))))


def work(splats: int) -> tuple[int, int]:
    """(tile, splat) records and (record, 4×4 block) pairs of the view: what the arithmetic floor is counted in."""
    gaussians, view = surface_splats(splats, torch.Generator().manual_seed(0)), camera()
    arrays = (gaussians.means, gaussians.quats, gaussians.log_scales, gaussians.opacity_logits)
    raster = _native.Raster()
    channels = _native.Channels(torch.zeros(splats, 1))
    images = [torch.zeros(1, SIDE, SIDE)]
    raster.forward(_native.Splats(*arrays), channels, native_camera(view), images, torch.zeros(SIDE, SIDE))
    return raster.records, raster.blocks


def iteration_ms(splats: int) -> float:
    """One training iteration as `goc carve` runs it: 3 colour + 4 plane channels + alpha, all losses, Adam, noise."""
    from goc.reconstruct import Mcmc, ReconstructConfig, reconstruct

    room, view = surface_splats(splats, torch.Generator().manual_seed(0)), camera()
    image = (torch.rand(SIDE, SIDE, 3) * 255).to(torch.uint8)
    pixels = torch.stack(torch.meshgrid(torch.arange(SIDE), torch.arange(SIDE), indexing="ij")[::-1], -1)
    rays = torch.cat([(pixels + 0.5 - SIDE / 2) / FOCAL, torch.ones(SIDE, SIDE, 1)], -1)
    hits = torch.stack([1.5 / rays[..., 0].abs(), 1.3 / rays[..., 1].abs(), torch.full((SIDE, SIDE), 3.5)], -1)
    frame = Frame(camera=view, image=image, depth=hits.amin(-1))
    frames = StoredFrames((frame, frame))
    capture = Capture(cameras=(view, view), view_names=("a", "b"), frames=frames, has_depth=True, has_ids=False)
    assert len(room) == splats
    stamps: list[float] = []

    def listen(event: object) -> None:
        if getattr(event, "stage", "") == "reconstruct":
            stamps.append(time.perf_counter())

    config = ReconstructConfig(iterations=40, checkpoint_every=0, mcmc=Mcmc(max_splats=splats))
    reconstruct(capture, config, listen)
    gaps = [1e3 * (b - a) for a, b in zip(stamps[5:], stamps[6:], strict=False)]
    return statistics.median(gaps)


def floor_ms(splats: int, pairs: int, channels: int, product_ms: float) -> float:
    """Time of the multiplications alone at the rate of the product, forward and backward.

    By count of the source (native/lanes/tiles.cpp with AVX-512), a (record, block) pair of 16 pixels takes 9 + c
    instructions that multiply forward (form 5, exponential 3, weight 1) and 21 + 2c backward (these again, what lies
    behind 1, reciprocal 3, gradient 3, moments 5). By count of the compiled native/lanes/project.cpp, without planes, a
    splat takes 467 multiplications (projection 132, twice; its image 31; its gradient 172) and 12 of 16 blocks each.
    """
    multiplications = 16 * pairs * (30 + 3 * channels) + splats * (467 + 12 * 16)
    return multiplications / (1024**3 / product_ms)


def product_ms() -> float:
    """A 1024² float32 product on all threads: beside each row, since the rate drifts within a run."""
    torch.set_num_threads(_native.thread_count())
    matrix = torch.rand(1024, 1024)
    took = median_ms(lambda: matrix @ matrix)
    torch.set_num_threads(1)
    return took


def measure() -> dict[str, Any]:
    """Everything, with the instruction set of this process."""
    records, pairs = work(60_000)
    rows, products = [], [product_ms()]
    for splats, channels in ((60_000, 4), (60_000, 8), (60_000, 24), (20_000, 8), (120_000, 8)):
        forward, backward = engine_times(splats, channels)
        products.append(product_ms())
        floor = floor_ms(splats, work(splats)[1], channels, statistics.mean(products[-2:]))
        rows.append({"splats": splats, "channels": channels, "forward_ms": forward, "backward_ms": backward})
        rows[-1] |= {"floor_ms": floor, "floors": (forward + backward) / floor}
    return {
        "simd": _native.simd_level(),
        "threads": _native.thread_count(),
        "product_ms": statistics.median(products),
        "records": records,
        "pairs": pairs,
        "engine": rows,
        "iteration_ms": iteration_ms(60_000),
        "votes_ms": votes_ms(60_000),
    }


def measured_with(simd: str) -> dict[str, Any]:
    """`measure` in a process of its own: the instruction set is chosen when the kernels are loaded."""
    # The threads of the product must not spin beside the engine's afterwards.
    environment = os.environ | {"GOC_SIMD": simd, "OMP_WAIT_POLICY": "PASSIVE"}
    command = [sys.executable, __file__, "--measure"]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return json.loads(done.stdout)


def main() -> None:
    """Print a table; write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--measure", action="store_true", help="print JSON of this process's instruction set alone")
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measure()))
        return
    # A machine that lacks one measures the next best: each is printed once.
    found = {run["simd"]: run for run in map(measured_with, ("avx512", "avx2"))}
    for run in found.values():
        print(
            f"{run['simd']}, {run['threads']} threads, 1024² float32 product on all: {run['product_ms']:.1f} ms; "
            f"{run['records']:,} records, {run['pairs']:,} (record, block) pairs of 60,000 splats"
        )
    print("\n| kernels | splats | channels | forward ms | backward ms | floor ms | both / floor |")
    print("|---|---|---|---|---|---|---|")
    for simd, run in found.items():
        for row in run["engine"]:
            print(
                f"| {simd} | {row['splats']} | {row['channels']} | {row['forward_ms']:.1f} | {row['backward_ms']:.1f} "
                f"| {row['floor_ms']:.1f} | {row['floors']:.1f} |"
            )
    for simd, run in found.items():
        print(
            f"\n{simd}: whole training iteration, 60,000 splats, 384²: {run['iteration_ms']:.1f} ms; "
            f"votes of one view, {IDS} ids, once a view after it: {run['votes_ms']:.1f} ms"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps(list(found.values()), indent=1))


if __name__ == "__main__":
    main()
