"""Reads command lines with tyro, and tells what is wrong with one in a line that spells flags as a user types them."""

import difflib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from functools import partial
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

import tyro

# tyro's one structured view of a misused command line. It is private: constraints.txt and pyproject.toml pin tyro.
from tyro import _errors as wrong

from goc.errors import ConfigError

T = TypeVar("T")
Flags = dict[tuple[type, str], str]
"""How the command line spells each field of each class of settings."""

_ARG, _SUBCOMMAND = type(tyro.conf.arg()), type(tyro.conf.subcommand())


def parse(kind: type[T] | Callable[..., T], words: Sequence[str], prog: str, description: str | None = None) -> T:
    """Make settings from a command line.

    Args:
        kind: dataclass of all arguments; a partial of one, for other defaults; or a union of subcommands.
        words: what follows `prog`.
        prog: the command, such as "goc carve".
        description: help above the options; the docstring of `kind` if None.

    Raises:
        ConfigError: one line that names the flag at fault and says what it needs.
        SystemExit: with code 0, after --help.
    """
    with _spelling(kind.func if isinstance(kind, partial) else kind):
        return tyro.cli(kind, prog=prog, description=description, args=words, config=(tyro.conf.DisallowNone,))


def parse_known(kind: type[T], words: Sequence[str], prog: str) -> T:
    """Make settings from those words of a command line that are for them, whatever else there is.

    Raises:
        ConfigError: as `parse` does.
    """
    with _spelling(kind):
        made, _ = tyro.cli(kind, prog=prog, args=words, return_unknown_args=True, add_help=False)
        return made


@contextmanager
def _spelling(kind: Any) -> Iterator[None]:
    """Turn what tyro or the settings themselves refuse into a ConfigError that spells flags."""
    flags = flags_of(kind)
    try:
        with wrong.on_parse_error(partial(_refuse, flags=flags, commands=_commands_of(kind))):
            yield
    except ConfigError as error:
        owner = error.owner
        if owner is None:
            raise
        text = error.spelled(lambda name: flags.get((owner, name), f"--{name.replace('_', '-')}"))
        raise ConfigError(text) from error


def flags_of(kind: Any) -> Flags:
    """Flags of a dataclass of arguments and of all settings that are nested in it, named as tyro names them.

    A boolean has a second one under the name `no_...`, where tyro makes a pair.
    """
    if get_origin(kind) is Union:
        return {key: flag for arm in get_args(kind) for key, flag in flags_of(arm).items()}
    return dict(_flags(_unwrapped(kind)[0], "", False))


def _commands_of(kind: Any) -> list[str]:
    """Names of the arms of a union of subcommands; none where there is no choice."""
    marks = [mark for arm in get_args(kind) for mark in _unwrapped(arm)[1]] if get_origin(kind) is Union else []
    return [mark.name for mark in marks if isinstance(mark, _SUBCOMMAND)]


def _flags(settings: type, prefix: str, omits: bool) -> Iterator[tuple[tuple[type, str], str]]:
    hints = get_type_hints(settings, include_extras=True)
    for item in fields(settings):
        bare, marks = _unwrapped(hints[item.name])
        argument = next((mark for mark in marks if isinstance(mark, _ARG)), None)
        name = item.name if argument is None or argument.name is None else argument.name
        name = name.replace("_", "-")
        if is_dataclass(bare):
            inner_omits = omits or tyro.conf.OmitArgPrefixes in marks
            inner = prefix if not name or inner_omits else f"{prefix}{name}."
            yield from _flags(bare, inner, inner_omits)
        elif tyro.conf.Positional in marks:
            yield (settings, item.name), argument.metavar if argument and argument.metavar else name.upper()
        else:
            yield (settings, item.name), f"--{prefix}{name}"
            if bare is bool and tyro.conf.FlagCreatePairsOff not in marks:
                yield (settings, f"no_{item.name}"), f"--{prefix}no-{name}"


def _unwrapped(hint: Any) -> tuple[Any, tuple[Any, ...]]:
    """A type without its annotations, and those."""
    return (get_args(hint)[0], hint.__metadata__) if get_origin(hint) is Annotated else (hint, ())


def _refuse(event: wrong.ParseErrorEvent, flags: Flags, commands: Sequence[str]) -> None:
    """Raise in our words; an event that tyro gets in future is left to tyro's."""
    more = f"`{event.prog} --help` tells what there is."
    match event:
        case wrong.UnrecognizedArgs(tokens=[first, *_]) | wrong.MissingArgs(unrecognized_tokens=[first, *_]):
            raise ConfigError(f"{_unknown(first, flags, commands)} {more}")
        case wrong.MissingArgs():
            lacking = " and ".join(_invocation(one.arg) for one in event.missing_arguments)
            raise ConfigError(f"{event.prog} needs {lacking}. {more}")
        case wrong.MissingSubcommand():
            raise ConfigError(f"{event.prog} needs a command: {_choices(commands)}. {more}")
        case wrong.InvalidChoice():
            choices = sorted(set(event.choices) - {"None"})
            raise ConfigError(f"{_name(event.argument)} is {event.value!r}: needs {_choices(choices)}.")
        case wrong.BadValue(reason="too_few_values"):
            raise ConfigError(f"{_name(event.argument)} has no value: needs {_metavar(event.argument)}. {more}")
        case wrong.InstantiationFailure(argument=argument) if argument is not None:
            raise ConfigError(f"{_name(argument)} {_misfit(event.message, _metavar(argument))}")


def _unknown(word: str, flags: Flags, commands: Sequence[str]) -> str:
    """A word that is no option, with what it may have been meant to be."""
    if not word.startswith("-"):
        return f"no command {word!r}: needs {_choices(commands)}." if commands else f"{word!r} is one word too many."
    given = word.partition("=")[0]
    known = sorted({flag for flag in flags.values() if flag.startswith("-")})
    close = [flag for flag in known if re.split(r"--|\.", flag)[-1] == given.lstrip("-")]
    close = (close or difflib.get_close_matches(given, known, n=2))[:2]
    hint = f" Did you mean {' or '.join(close)}?" if close else ""
    return f"no option {given}.{hint}"


def _misfit(message: str, metavar: str) -> str:
    """What is wrong with a value, from tyro's longer text."""
    quoted = re.findall(r"'([^']*)'", message)
    if quoted and "for int()" in message:
        return f"is {quoted[-1]!r}: needs a whole number."
    if quoted and "to float" in message:
        return f"is {quoted[-1]!r}: needs a number."
    return f"needs {metavar}."


def _name(argument: Any) -> str:
    lowered = argument.lowered
    return str(lowered.metavar) if argument.is_positional() else lowered.name_or_flags[0]


def _metavar(argument: Any) -> str:
    return _choices(str(argument.lowered.metavar).strip("{}").split(","))


def _invocation(argument: Any) -> str:
    name = _name(argument)
    return name if argument.is_positional() else f"{name} {_metavar(argument)}"


def _choices(names: Sequence[str]) -> str:
    return " or ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
