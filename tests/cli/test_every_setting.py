"""Every numeric setting of every command: a value is in its range, or refused in one line that names the flag."""

from dataclasses import fields, is_dataclass
from typing import get_args, get_origin, get_type_hints

import pytest

from goc.cli import bench, carve, complete, demo, doctor, eval, osc, synth
from goc.cli.arguments import flags_of, parse
from goc.cli.failures import guarded
from goc.settings import Settings, ranges

COMMANDS = {
    "bench": (bench.Arguments, ["bench"]),
    "carve": (carve.Arguments, ["carve", "in", "--out", "out"]),
    "complete": (complete.Arguments, ["complete", "in", "--out", "out.ply"]),
    "demo": (demo.Arguments, ["demo"]),
    "doctor": (doctor.Arguments, ["doctor"]),
    "eval": (eval.Arguments, ["eval", "run", "--truth", "in"]),
    "osc prepare": (osc.Prepare, ["osc", "prepare", "in", "out"]),
    "osc train": (osc.Train, ["osc", "train", "out"]),
    "osc eval": (osc.Evaluate, ["osc", "eval", "in"]),
    "synth room": (synth.Room, ["synth", "room", "out"]),
    "synth sensor": (synth.Sensor, ["synth", "sensor", "in", "out"]),
}
VALUES = {int: ["-1", "0", "1000000000000000000000", "nan"], float: ["nan", "inf", "-inf", "-1", "0", "1e300"]}
MODELS = ("kinect", "phone", "monocular")


def parts(hint):
    """A hint and all that it is made of."""
    yield hint
    for part in get_args(hint):
        yield from parts(part)


def groups(kind):
    """The dataclass and all that are nested in it."""
    yield kind
    for hint in get_type_hints(kind, include_extras=True).values():
        for part in parts(hint):
            if is_dataclass(part) and isinstance(part, type):
                yield from groups(part)


def numeric_fields(kind):
    for group in groups(kind):
        hints = get_type_hints(group, include_extras=True)
        for item in fields(group):
            numbers = {part for part in parts(hints[item.name]) if part in (int, float)}
            if numbers:
                yield group, item.name, numbers.pop()


def width_of(group, name):
    """Numbers that a setting takes."""
    hint = get_type_hints(group)[name]
    return max((len(get_args(part)) for part in parts(hint) if get_origin(part) is tuple), default=1)


def settings_of(command):
    kind, _ = COMMANDS[command]
    flags = flags_of(kind)
    return [(flags[group, name], group, name, number) for group, name, number in numeric_fields(kind)]


def read(command, words):
    kind, base = COMMANDS[command]
    rest = [*base[len(command.split()) :], *words]
    return carve.arguments_of(rest) if command == "carve" else parse(kind, rest, f"goc {command}")


CASES = [(command, *case) for command in COMMANDS for case in settings_of(command)]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_numeric_setting_states_its_range_and_stands_once(command):
    kind, _ = COMMANDS[command]
    found = list(numeric_fields(kind))
    assert all(issubclass(group, Settings) for group, _, _ in found)
    assert not [f"{group.__name__}.{name}" for group, name, _ in found if name not in ranges(group)]
    assert len({(group, name) for group, name, _ in found}) == len(found)
    assert all(len(fields(group)) <= 12 for group in groups(kind))


@pytest.mark.parametrize(("command", "flag", "group", "name", "number"), CASES, ids=[" ".join(c[:2]) for c in CASES])
def test_every_value_is_in_range_or_refused_in_one_line(capsys, command, flag, group, name, number):
    for value in VALUES[number]:
        model = flag[2:].partition(".")[0]
        words = [flag, *[value] * width_of(group, name)] + ["--model", model] * (model in MODELS)
        code = guarded(lambda words=words: 0 if read(command, words) else 1, debug=False)
        said = capsys.readouterr().err
        if code == 0:
            assert number(value) in ranges(group)[name]
        else:
            assert code == 2 and said.count("\n") == 1
            assert said.startswith("error: ") and flag in said and "needs" in said, said
