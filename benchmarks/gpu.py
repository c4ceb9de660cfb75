"""Measure the CUDA engine: `python benchmarks/gpu.py [--room CAPTURE] [--paper] [--json FILE]`.

Prints tables: how far gsplat is from the CPU engine on 60,000 splats, milliseconds of a view forward and backward and
of a training step, seconds of a whole `goc carve` (with --room; with --paper its preset paper too), and seconds of the
completion of an object by a network of the paper's sizes with random weights. Says in one line why it cannot run where
there is no device, and ends with 4.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

import engine as cpu
from goc.complete import SIZES, QueryGrid, Refinement, bounding_cube, build, decode, partial_object
from goc.errors import EngineError
from goc.events import Event, Progress
from goc.raster import NATIVE, Engine, choose_engine, views_of
from goc.reconstruct import Mcmc, ReconstructConfig, reconstruct
from goc.scene import Capture, EvidenceGrid, Frame, Gaussians, StoredFrames

SPLATS = 60_000
NAMES = ("means", "quats", "log_scales", "opacity_logits")
BOUNDS_S = {"fast": 90.0, "paper": 360.0}
"""Aims: carve and complete a room, and the paper's preset."""


def median_ms(action: Callable[[], object], repeats: int = 20) -> float:
    """Median wall time after three warm-up calls, the device waited for each time."""
    times = []
    for turn in range(repeats + 3):
        torch.cuda.synchronize()
        start = time.perf_counter()
        action()
        torch.cuda.synchronize()
        if turn >= 3:
            times.append(1e3 * (time.perf_counter() - start))
    return statistics.median(times)


def room_splats(device: torch.device) -> Gaussians:
    """The splats of benchmarks/engine.py, to be differentiated."""
    splats = cpu.surface_splats(SPLATS, torch.Generator().manual_seed(0))
    return replace(splats, **{name: getattr(splats, name).to(device).requires_grad_() for name in NAMES})


def parity(engine: Engine) -> dict[str, dict[str, float]]:
    """Largest and mean difference of values and gradients from the CPU engine, as shares of the largest."""
    channels = torch.rand(SPLATS, 8, generator=torch.Generator().manual_seed(1))
    results = []
    for drawn in (NATIVE, engine):
        splats = room_splats(drawn.device)
        image, alpha = drawn.blend(splats, views_of([cpu.camera()], drawn.device), channels.to(drawn.device)[None])
        (image.square().mean() + alpha.square().mean()).backward()
        found = {"image": image, "alpha": alpha} | {name: getattr(splats, name).grad for name in NAMES}
        results.append({name: value.detach().cpu() for name, value in found.items()})
    rows = {}
    for name, exact in results[0].items():
        off = (results[1][name] - exact).abs() / exact.abs().max()
        rows[name] = {"largest": off.max().item(), "mean": off.mean().item()}
    return rows


def view_times(engine: Engine) -> list[dict[str, float]]:
    """Forward and backward of one to four views, milliseconds a view."""
    rows = []
    for count, width in ((1, 4), (1, 8), (4, 8), (1, 16), (4, 16), (1, 32)):
        splats, views = room_splats(engine.device), views_of([cpu.camera()] * count, engine.device)
        channels = torch.rand(count, SPLATS, width, device=engine.device).requires_grad_()
        image, alpha = engine.blend(splats, views, channels)
        upstream = torch.rand_like(image), torch.rand_like(alpha)

        def draw(parts: tuple = (splats, views, channels)) -> tuple[torch.Tensor, torch.Tensor]:
            return engine.blend(*parts)

        def both(wanted: tuple = upstream, drawn: Callable = draw) -> None:
            torch.autograd.backward(drawn(), wanted)

        forward, whole = median_ms(draw), median_ms(both)
        rows.append({"views": count, "channels": width, "forward_ms": forward / count})
        rows[-1]["backward_ms"] = (whole - forward) / count
    return rows


def step_ms(engine: Engine, views: int) -> float:
    """A step of `reconstruct` with all losses of preset fast, Adam and noise, of some views of a wall 3 m away."""
    cameras = []
    for place in range(8):  # far enough apart to be compared with each other
        pose = torch.eye(4)
        pose[0, 3] = 0.1 * place
        cameras.append(replace(cpu.camera(), world_from_cam=pose))
    image, depth = (torch.rand(cpu.SIDE, cpu.SIDE, 3) * 255).to(torch.uint8), torch.full((cpu.SIDE, cpu.SIDE), 3.0)
    frames = StoredFrames(tuple(Frame(camera=camera, image=image, depth=depth) for camera in cameras))
    capture = Capture(
        cameras=tuple(cameras), view_names=tuple("abcdefgh"), frames=frames, has_depth=True, has_ids=False
    )
    stamps: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, Progress) and event.stage == "reconstruct" and event.done % 50 == 0:
            torch.cuda.synchronize()
            stamps.append(time.perf_counter())

    config = ReconstructConfig(iterations=400, checkpoint_every=0, views_a_step=views, mcmc=Mcmc(max_splats=SPLATS))
    reconstruct(capture, config, listen, engine=engine)
    return 1e3 * statistics.median(b - a for a, b in zip(stamps[1:], stamps[2:], strict=False)) / 50


def carve_seconds(room: Path, preset: str) -> dict[str, float]:
    """Seconds of a whole run, by stage and together with its start, and what it reached."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        words = ["carve", str(room), "--out", str(out), "--preset", preset, "--device", "cuda"]
        started = time.perf_counter()
        subprocess.run([sys.executable, "-m", "goc.cli", *words], check=True, stdout=subprocess.DEVNULL)
        whole = time.perf_counter() - started
        report = json.loads((out / "report.json").read_text())
    return {"whole": whole, **report["seconds"], "psnr_db": report["metrics"].get("held_out_psnr_db")}


def completion_seconds(size: str, device: torch.device) -> float:
    """A half-seen ball by a network of a size, on a lattice of 128 voxels a side.

    An upper bound: random weights are unsure everywhere, so that all 128³ voxels are asked.
    """
    points = np.random.default_rng(0).normal(size=(20_000, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points[:, 2] = np.abs(points[:, 2])
    nothing = EvidenceGrid(
        origin=-np.ones(3), voxel=0.1, state=np.zeros((20,) * 3, np.uint8), sdf=np.zeros((20,) * 3, np.float32)
    )
    partial = partial_object(points, points, nothing, bounding_cube(points))
    network = build(SIZES[size]).eval().to(device)
    lattice = QueryGrid(origin=-np.ones(3), voxel=2.0 / 127, shape=(128,) * 3)
    return median_ms(lambda: decode(network.complete(partial), lattice, Refinement()), repeats=3) / 1e3


def show(document: dict) -> None:
    """Print the tables."""
    print(f"{document['device']}, torch {document['torch']}\n\n| | largest | mean |\n|---|---|---|")
    for name, row in document["parity"].items():
        print(f"| {name} | {row['largest']:.1e} | {row['mean']:.1e} |")
    print("\n| views a call | channels | forward ms a view | backward ms a view |\n|---|---|---|---|")
    for row in document["views"]:
        print(f"| {row['views']} | {row['channels']} | {row['forward_ms']:.2f} | {row['backward_ms']:.2f} |")
    for views, milliseconds in document["step_ms"].items():
        print(f"\ntraining step of {views} view(s): {milliseconds:.2f} ms")
    for size, seconds in document["completion_s"].items():
        print(f"\nOSC-{size}: {seconds:.2f} s an object")
    for preset, seconds in document["carve_s"].items():
        kept = "within" if seconds["whole"] <= BOUNDS_S[preset] else "above"
        stages = ", ".join(f"{name} {value:.1f}" for name, value in seconds.items() if value is not None)
        print(f"\n--preset {preset}: {seconds['whole']:.1f} s, {kept} {BOUNDS_S[preset]:.0f} s ({stages})")


def main() -> int:
    """Measure what there is, print it, write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--room", type=Path, help="a capture to carve, such as one that `goc synth room` made")
    parser.add_argument("--paper", action="store_true", help="carve it with the paper's 30,000 steps too")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    try:
        engine = choose_engine("cuda")
    except EngineError as error:
        print(f"nothing measured: {error}")
        return error.exit_code
    presets = (["fast"] + ["paper"] * arguments.paper) if arguments.room else []
    document = {
        "device": torch.cuda.get_device_name(engine.device),
        "torch": torch.__version__,
        "parity": parity(engine),
        "views": view_times(engine),
        "step_ms": {views: step_ms(engine, views) for views in (1, 2, 4)},
        "completion_s": {size: completion_seconds(size, engine.device) for size in ("S", "M")},
        "carve_s": {preset: carve_seconds(arguments.room, preset) for preset in presets},
    }
    show(document)
    if arguments.json:
        arguments.json.write_text(json.dumps(document, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
