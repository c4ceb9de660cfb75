"""The command line. Thin: it parses, listens to events, and turns errors into one line.

Nothing heavy is imported before a command is known, so that `goc --help` answers at once.
"""

import difflib
import importlib
import os
import sys
from collections.abc import Sequence

from goc import __version__
from goc.cli.failures import guarded

_COMMANDS = ("carve", "inspect", "complete", "demo", "eval", "synth", "bench", "osc", "doctor")
_USAGE = """\
usage: goc [--help] [--version] COMMAND ...

goc, the Gaussian Object Carver: photographs of a room in, separate objects out.

commands:
  carve CAPTURE --out OUT   turn a folder of posed photographs into a scene and its objects
  inspect CAPTURE           tell what a capture holds, and what is wrong with it
  complete INPUT --out MESH close one partial point cloud or mesh
  demo                      make a furnished room, photograph it and carve it: needs no data
  synth room|sensor         make a room with complete ground truth, or give a capture a sensor's faults
  eval RUN --truth CAPTURE  score a run against complete ground truth, by protocols of fixed numbers
  bench                     measure the paper's tables again, and write them as Markdown
  osc                       prepare data for, train and score the network that completes objects
  doctor                    say what this machine can do, and how to mend what it cannot

options:
  -h, --help                this text; `goc COMMAND --help` tells all settings of a command
  --version                 version of goc
  --debug                   after any command: show the traceback of an error

examples:
  goc demo                                      from nothing to pictures in a few minutes
  goc carve captures/kitchen --out kitchen      all settings at their defaults
  goc carve captures/kitchen --out kitchen --resume
                                                continue a run that was stopped
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code: 0 well, 2 misused, 3 bad data, 4 resources, 5 failed, 130 stopped."""
    # torch's idle threads would spin against goc's own; it reads this when it is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    words = [word for word in given if word != "--debug"]
    match words:
        case [] | ["-h" | "--help" | "help", *_]:
            sys.stdout.write(_USAGE)
            return 0
        case ["--version", *_]:
            sys.stdout.write(f"goc {__version__}\n")
            return 0
        case [command, *rest] if command in _COMMANDS:
            return guarded(lambda: importlib.import_module(f"goc.cli.{command}").main(rest), debug)
    sys.stderr.write(f"error: no command {words[0]!r}.{_suggestion(words[0])} `goc --help` tells what there is.\n")
    return 2


def _suggestion(word: str) -> str:
    close = difflib.get_close_matches(word, _COMMANDS, n=1)
    return f" Did you mean `goc {close[0]}`?" if close else ""
