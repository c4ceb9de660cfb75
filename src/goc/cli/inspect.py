"""`goc inspect`: what a capture holds, and what is wrong with it, before seconds are spent on it."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import msgspec
import tyro

from goc.capture import CaptureConfig
from goc.capture.inspect import inspect_capture
from goc.cli.arguments import parse
from goc.cli.progress import shown_progress
from goc.events import ignore
from goc.files import write_bytes
from goc.report.inspect_page import inspect_page
from goc.report.inspect_text import text_of
from goc.settings import Settings

_DESCRIPTION = """Tell what a capture holds, whether it agrees with itself, and which views and ids are damaged.

Format, cameras, depth, ids, unit and up; whether views agree through depth (or, without it, through the photographs),
and what the numbers look like where they do not; blurred views, exposure jumps, poses that disagree with depth, objects
that few views show, ids that flicker, merge or split. Nothing is written, unless a page is asked for.

examples:
  goc inspect captures/kitchen
  goc inspect captures/kitchen --out kitchen.html
  goc inspect captures/kitchen --json > kitchen.json
  goc inspect captures/kitchen --capture.convention.poses world-to-camera"""

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


@dataclass(frozen=True, kw_only=True)
class Arguments(Settings):
    """The arguments of the command line."""

    source: Annotated[Path, tyro.conf.arg(metavar="CAPTURE"), tyro.conf.Positional]
    """Folder or file of the capture."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="PAGE", help_behavior_hint="")] = None
    """Write one self-contained HTML page: findings, damage, the cameras around the points, a contact sheet."""
    json: Flag = False
    """Print JSON instead of text."""
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    """Reading the capture."""


def main(words: Sequence[str]) -> int:
    """Run `goc inspect` with the words that follow it."""
    given = parse(Arguments, words, "goc inspect", _DESCRIPTION)
    if given.json:
        found = inspect_capture(given.source, given.capture, ignore)
        sys.stdout.write(msgspec.json.format(msgspec.json.encode(found.inspection), indent=1).decode() + "\n")
    else:
        with shown_progress() as notify:
            found = inspect_capture(given.source, given.capture, notify)
        sys.stdout.write(text_of(found.inspection))
    if given.out is not None:
        write_bytes(given.out, inspect_page(found).encode())
        sys.stderr.write(f"page: {given.out}\n")
    return 0
