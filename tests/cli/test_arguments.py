from dataclasses import dataclass, field
from typing import Annotated, Literal

import pytest
import tyro

from goc.cli.arguments import flags_of, parse, parse_known
from goc.errors import ConfigError
from goc.settings import Count, Finite, Settings, Share


@dataclass(frozen=True, kw_only=True)
class Leaf(Settings):
    share: Share = 0.5
    steps: Count | None = None
    sharp: bool = True
    method: Literal["slow", "fast"] | None = None

    def __post_init__(self):
        super().__post_init__()
        if self.sharp and self.steps == 13:
            raise ConfigError("{steps} 13 needs {no_sharp}, or another {share}.", type(self))


@dataclass(frozen=True, kw_only=True)
class Branch:
    leaf: Leaf = field(default_factory=Leaf)


@dataclass(frozen=True, kw_only=True)
class Tree(Settings):
    source: Annotated[str, tyro.conf.arg(metavar="IN"), tyro.conf.Positional]
    out: str
    at: tuple[Finite, Finite] | None = None
    branch: Annotated[Branch, tyro.conf.arg(name="")] = field(default_factory=Branch)


@dataclass(frozen=True, kw_only=True)
class Flat:
    branch: Annotated[Branch, tyro.conf.arg(name=""), tyro.conf.OmitArgPrefixes] = field(default_factory=Branch)


Command = Annotated[Tree, tyro.conf.subcommand("tree")] | Annotated[Flat, tyro.conf.subcommand("flat")]


def test_settings_are_spelled_where_they_are_nested():
    assert flags_of(Tree) == {
        (Tree, "source"): "IN",
        (Tree, "out"): "--out",
        (Tree, "at"): "--at",
        (Leaf, "share"): "--leaf.share",
        (Leaf, "steps"): "--leaf.steps",
        (Leaf, "sharp"): "--leaf.sharp",
        (Leaf, "no_sharp"): "--leaf.no-sharp",
        (Leaf, "method"): "--leaf.method",
    }
    assert flags_of(Flat)[Leaf, "no_sharp"] == "--no-sharp"


def test_words_become_settings():
    made = parse(Tree, ["in", "--leaf.share", "1", "--out", "x", "--at", "-1", "2", "--leaf.no-sharp"], "goc t")
    assert (made.source, made.out, made.at) == ("in", "x", (-1.0, 2.0))
    assert made.branch.leaf == Leaf(share=1.0, sharp=False)
    assert parse(Command, ["flat", "--steps", "3"], "goc t") == Flat(branch=Branch(leaf=Leaf(steps=3)))
    assert parse_known(Flat, ["in", "--out", "x", "--share", "1.0"], "goc t").branch.leaf.share == 1.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "goc t needs IN and --out STR. `goc t --help` tells what there is."),
        (["in", "--oot", "x"], "no option --oot. Did you mean --out or"),
        (["in", "--out=x", "--share=3"], "no option --share. Did you mean --leaf.share?"),
        (["in", "--out=x", "--leaf.no-sharpp"], "no option --leaf.no-sharpp. Did you mean --leaf.no-sharp or"),
        (["in", "more", "--out", "x"], "'more' is one word too many."),
        (["in", "--out"], "--out has no value: needs STR."),
        (["in", "--out", "x", "--leaf.steps", "2.5"], "--leaf.steps is '2.5': needs a whole number."),
        (["in", "--out", "x", "--leaf.share", "much"], "--leaf.share is 'much': needs a number."),
        (["in", "--out", "x", "--leaf.share", "-1"], "--leaf.share is -1: needs 0 to 1."),
        (["in", "--out", "x", "--leaf.method", "odd"], "--leaf.method is 'odd': needs fast or slow."),
        (["in", "--out", "x", "--at", "1"], "--at needs FLOAT FLOAT."),
        (["in", "--out", "x", "--at", "1", "nan"], "--at is 1 nan: needs a finite number."),
        (["in", "--out", "x", "--leaf.steps=13"], "--leaf.steps 13 needs --leaf.no-sharp, or another --leaf.share."),
    ],
)
def test_misuse_is_one_line_that_spells_flags_as_they_are_typed(words, said):
    with pytest.raises(ConfigError) as caught:
        parse(Tree, words, "goc t")
    assert str(caught.value).startswith(said) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["bush"], "no command 'bush': needs tree or flat."),
        ([], "goc t needs a command: tree or flat."),
        (["flat", "--share", "2"], "--share is 2: needs 0 to 1."),
    ],
)
def test_misused_subcommands_are_one_line(words, said):
    with pytest.raises(ConfigError) as caught:
        parse(Command, words, "goc t")
    assert str(caught.value).startswith(said)
