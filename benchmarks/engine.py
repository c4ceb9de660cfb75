"""Time the engine and one training iteration: `python benchmarks/engine.py [--json FILE]`.

Scene: 60,000 splats on the surfaces of a box room, all in view of a 384×384 camera, 8 channels. Figures are medians.
Absolute times drift from machine to machine: the last column is a ratio to a float32 matrix product measured in the
same run.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch

from goc import _native
from goc.geometry.rotations import quats_towards
from goc.raster import rasterize
from goc.raster.rasterize import native_camera
from goc.scene import Camera, Capture, Frame, Gaussians

SIDE, FOCAL = 384, 295.65


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


def median_ms(action: Callable[[], object], repeats: int = 15) -> float:
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
    forward = median_ms(lambda: rasterize(gaussians, view, values))
    both = median_ms(lambda: torch.autograd.backward(rasterize(gaussians, view, values), upstream))
    return forward, both - forward


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
    capture = Capture(
        cameras=(view, view), names=("a", "b"), load=lambda _: frame, has_depth=True, has_ids=False, labels={}
    )
    assert len(room) == splats
    stamps: list[float] = []

    def listen(event: object) -> None:
        if getattr(event, "stage", "") == "reconstruct":
            stamps.append(time.perf_counter())

    config = ReconstructConfig(iterations=40, checkpoint_every=0, mcmc=Mcmc(max_splats=splats))
    reconstruct(capture, config, listen)
    gaps = [1e3 * (b - a) for a, b in zip(stamps[5:], stamps[6:], strict=False)]
    return statistics.median(gaps)


def main() -> None:
    """Print a table; write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    matrix = torch.rand(1024, 1024)
    reference = median_ms(lambda: matrix @ matrix)
    rows = []
    for splats, channels in ((60_000, 4), (60_000, 8), (60_000, 24), (20_000, 8), (120_000, 8)):
        forward, backward = engine_times(splats, channels)
        rows.append({"splats": splats, "channels": channels, "forward_ms": forward, "backward_ms": backward})
    iteration = iteration_ms(60_000)
    print(
        f"{_native.simd_level()}, {_native.thread_count()} threads, 1024² float32 product on one: {reference:.1f} ms\n"
    )
    print("| splats | channels | forward ms | backward ms | both / product |")
    print("|---|---|---|---|---|")
    for row in rows:
        both = row["forward_ms"] + row["backward_ms"]
        print(
            f"| {row['splats']} | {row['channels']} | {row['forward_ms']:.1f} | {row['backward_ms']:.1f} "
            f"| {both / reference:.2f} |"
        )
    records, pairs = work(60_000)
    print(f"\n60,000 splats: {records:,} records, {pairs:,} (record, block) pairs")
    print(f"\nwhole training iteration, 60,000 splats, 384²: {iteration:.1f} ms ({iteration / reference:.2f} products)")
    if arguments.json:
        document = {"simd": _native.simd_level(), "threads": _native.thread_count(), "reference_ms": reference}
        arguments.json.write_text(json.dumps(document | {"engine": rows, "iteration_ms": iteration}, indent=1))


if __name__ == "__main__":
    main()
