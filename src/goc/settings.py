"""Base class and ranges of settings: each field states its range in its type, and is checked when an object is made."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from goc.errors import ConfigError

_LARGEST = 2**31 - 1
"""Largest absolute value of any setting, which float32 and the integers of the kernels can hold."""

Number = int | float


@dataclass(frozen=True, kw_only=True)
class Range:
    """Values that a setting may have; NaN and infinity are in no range."""

    least: Number | None = None
    above: Number | None = None
    most: Number | None = None
    below: Number | None = None

    def __contains__(self, value: Number) -> bool:
        """Whether a setting may have this value."""
        return (
            abs(value) <= _LARGEST
            and (self.least is None or value >= self.least)
            and (self.above is None or value > self.above)
            and (self.most is None or value <= self.most)
            and (self.below is None or value < self.below)
        )

    def __str__(self) -> str:
        """The range in words, for example `0 to 1` or `more than 0`."""
        if self.least is not None and self.most is not None:
            return f"{self.least} to {self.most}"
        low = f"{self.least} or more" if self.least is not None else f"more than {self.above}"
        if self.least is None and self.above is None:
            low = "a finite number"
        if self.most is not None:
            return f"{low}, at most {self.most}"
        return low if self.below is None else f"{low}, below {self.below}"

    def demand(self, value: Number) -> str:
        """The range in words for the message about a value outside."""
        is_huge = value > _LARGEST and self.most is None and self.below is None
        return f"{self}, at most {_LARGEST}" if is_huge else str(self)


Seed = Annotated[int, Range(least=0)]
"""A seed of random numbers."""
Count = Annotated[int, Range(least=1)]
"""A number of things, one or more."""
CountOrNone = Annotated[int, Range(least=0)]
"""A number of things; 0 means none or never."""
Share = Annotated[float, Range(least=0, most=1)]
"""A share of a whole, 0 to 1."""
OpenShare = Annotated[float, Range(above=0, below=1)]
"""A share of a whole between 0 and 1, without both: thresholds and opacities, which need a finite logit."""
Amount = Annotated[float, Range(least=0)]
"""A weight, rate or length, 0 or more."""
Positive = Annotated[float, Range(above=0)]
"""A length, factor or duration that must not vanish."""
Finite = Annotated[float, Range()]
"""Any number."""


class Settings:
    """Base of all dataclasses of settings: refuses fields outside the range that their type states.

    Rules between fields belong into `__post_init__` of the subclass, after `super().__post_init__()`.

    Raises:
        ConfigError: names the field, its value and its range.
    """

    def __post_init__(self) -> None:
        """Check the range of every field."""
        for name, bounds in ranges(type(self)).items():
            value = getattr(self, name)
            values = tuple(_numbers(value))
            for one in values:
                if one not in bounds:
                    shown = " ".join(f"{each:.12g}" if isinstance(each, float) else str(each) for each in values)
                    raise ConfigError(f"{{{name}}} is {shown}: needs {bounds.demand(one)}.", type(self))


def _numbers(value: object) -> Iterator[Any]:
    """All that a value holds, out of tuples of tuples; nothing of None."""
    if isinstance(value, tuple):
        for part in value:
            yield from _numbers(part)
    elif value is not None:
        yield value


@cache
def ranges(settings: type) -> dict[str, Range]:
    """Ranges by field of a dataclass, for fields whose type states one, also inside `X | None` and tuples."""
    hints = get_type_hints(settings, include_extras=True)
    found = {item.name: _range_of(hints[item.name]) for item in fields(settings)}
    return {name: bounds for name, bounds in found.items() if bounds is not None}


def _range_of(hint: object) -> Range | None:
    if get_origin(hint) is Annotated:
        stated = next((one for one in get_args(hint)[1:] if isinstance(one, Range)), None)
        return stated or _range_of(get_args(hint)[0])
    return next((found for part in get_args(hint) if (found := _range_of(part)) is not None), None)
