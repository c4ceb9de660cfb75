from dataclasses import dataclass
from typing import Annotated

import pytest

from goc.errors import ConfigError
from goc.settings import Amount, Count, CountOrNone, Finite, OpenShare, Positive, Range, Seed, Settings, Share, ranges


@dataclass(frozen=True, kw_only=True)
class Inner(Settings):
    share: Share = 0.5
    count: Count | None = None
    at: tuple[Finite, Finite] | None = None
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class Child(Inner):
    least: Annotated[int, Range(least=3, most=9)] = 4


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"share": 1.5}, r"^Inner\.share is 1\.5: needs 0 to 1\.$"),
        ({"share": float("nan")}, r"^Inner\.share is nan: needs 0 to 1\.$"),
        ({"count": 0}, r"^Inner\.count is 0: needs 1 or more\.$"),
        ({"count": 10**400}, r"needs 1 or more, at most 2147483647\.$"),
        ({"at": (0.0, float("inf"))}, r"^Inner\.at is 0 inf: needs a finite number"),
    ],
)
def test_a_field_out_of_range_is_refused_by_name(settings, said):
    with pytest.raises(ConfigError, match=said):
        Inner(**settings)


def test_ranges_are_inherited_and_optional_fields_may_be_absent():
    assert ranges(Child)["least"] == Range(least=3, most=9)
    assert set(ranges(Child)) == {"share", "count", "at", "least"}
    assert Child().count is None
    with pytest.raises(ConfigError, match=r"Child\.share is -1"):
        Child(share=-1.0)


@pytest.mark.parametrize(
    ("kind", "inside", "outside"),
    [
        (Seed, [0, 2**31 - 1], [-1, 2**31]),
        (Count, [1, 2**31 - 1], [0, -1, 2**31]),
        (CountOrNone, [0, 7], [-1]),
        (Share, [0.0, 1.0], [-1e-9, 1.0 + 1e-9]),
        (OpenShare, [1e-9, 0.999], [0.0, 1.0]),
        (Amount, [0.0, 5e5], [-1e-9, 1e300]),
        (Positive, [1e-9, 5e5], [0.0, -1.0]),
        (Finite, [-3.0, 0.0], [1e300, -1e300]),
    ],
)
def test_ends_of_every_range(kind, inside, outside):
    (bounds,) = kind.__metadata__
    assert all(value in bounds for value in inside)
    assert not any(value in bounds for value in [*outside, float("nan"), float("inf"), float("-inf")])


def test_an_error_spells_its_fields_as_it_is_told():
    error = ConfigError("{share} is 3: needs less than {at}. {", Inner)
    assert str(error) == "Inner.share is 3: needs less than Inner.at. {"
    assert error.spelled(lambda name: f"--inner.{name}") == "--inner.share is 3: needs less than --inner.at. {"
    assert str(ConfigError("/tmp/{share}: is not empty")) == "/tmp/{share}: is not empty"
