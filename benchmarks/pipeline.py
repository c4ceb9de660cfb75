"""Time the whole pipeline by stage: `python benchmarks/pipeline.py [CAPTURE] [--json FILE] [options of goc carve]`.

Without CAPTURE: 60 views of 384² of a room that `goc synth room` makes, kept in build/benchmarks. The run is a process
of its own. Absolute times drift from machine to machine and from hour to hour: the last column counts in float32
matrix products of 1024², measured in this process before and after.
"""

import argparse
import json
import statistics
import sys
from dataclasses import asdict
from pathlib import Path

from goc import _native
from goc.synth.captures import RoomConfig, make_room_capture
from runs import Measured, reference_ms, run_apart

KEPT = Path(__file__).parent.parent / "build" / "benchmarks"


def synth_room() -> Path:
    """A furnished room, made once."""
    folder = KEPT / "room-60x384"
    if not (folder / "transforms.json").is_file():
        print(f"making {folder}, which takes a minute or more", file=sys.stderr)
        folder.parent.mkdir(parents=True, exist_ok=True)
        make_room_capture(folder, RoomConfig(views=60, width=384, height=384))
    return folder


def table(run: Measured, reference: float) -> str:
    """By piece of work, and together."""
    lines = ["| work | s | share | products |", "|---|---|---|---|"]
    for name, seconds in [*run.seconds.items(), ("together", run.total)]:
        products = f"{1e3 * seconds / reference:,.0f}"
        lines.append(f"| {name} | {seconds:.2f} | {seconds / run.total:.0%} | {products} |")
    step = f"{run.step_ms:.1f} ms a step (median {run.median_step_ms:.1f}, {run.step_ms / reference:.2f} products)"
    quality = "" if run.psnr_db is None else f", {run.psnr_db:.2f} dB"
    lines += ["", f"{step}, {run.splats:,} splats{quality}, {run.objects} objects, peak {run.peak_mb:,.0f} MB"]
    return "\n".join(lines)


def main() -> None:
    """Print a table; write it as JSON where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path, nargs="?")
    parser.add_argument("--json", type=Path)
    given, options = parser.parse_known_args()
    capture = given.capture or synth_room()
    before = reference_ms()
    run = run_apart(capture, options)
    after = reference_ms()
    reference = statistics.mean((before, after))
    print(f"{capture.name} {' '.join(options)}".strip())
    print(
        f"{_native.simd_level()}, {_native.thread_count()} threads; product {before:.1f} ms before, {after:.1f} after\n"
    )
    print(table(run, reference))
    if given.json:
        document = {"capture": str(capture), "options": options, "reference_ms": [before, after]}
        document |= {"simd": _native.simd_level(), "threads": _native.thread_count()}
        given.json.write_text(json.dumps(document | asdict(run), indent=1))


if __name__ == "__main__":
    main()
