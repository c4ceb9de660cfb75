"""Small log-log charts side by side, drawn with Pillow."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

WIDTH, HEIGHT, MARGIN = 440, 380, 62
PAPER, INK, FAINT = (250, 250, 248), (34, 36, 40), (200, 202, 206)
COLOURS = ((31, 97, 168), (196, 84, 26), (60, 128, 62), (128, 70, 150))


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Lines over one quantity."""

    title: str
    x: tuple[float, ...]
    lines: dict[str, tuple[float, ...]]
    """By name, with unit; values above 0."""


class _Axes:
    """Where numbers are on one chart."""

    def __init__(self, chart: Chart, left: int) -> None:
        values = [value for line in chart.lines.values() for value in line]
        self.x, self.y = _span(chart.x), _span(values)
        self.left = left

    def at(self, x: float, y: float) -> tuple[float, float]:
        across = (math.log(x) - self.x[0]) / (self.x[1] - self.x[0])
        up = (math.log(y) - self.y[0]) / (self.y[1] - self.y[0])
        return (
            self.left + MARGIN + across * (WIDTH - 1.5 * MARGIN),
            HEIGHT - MARGIN - up * (HEIGHT - 2.2 * MARGIN),
        )


def _span(values: Sequence[float]) -> tuple[float, float]:
    low, high = math.log(min(values)), math.log(max(values))
    room = 0.06 * (high - low) + 0.05
    return low - room, high + room


def draw(charts: Sequence[Chart], path: Path) -> None:
    """Write the charts as one PNG; dashes rise as a cost does that is proportional to the quantity."""
    page = Image.new("RGB", (WIDTH * len(charts), HEIGHT), PAPER)
    pen = ImageDraw.Draw(page)
    small, large = ImageFont.load_default(13), ImageFont.load_default(17)
    for number, chart in enumerate(charts):
        axes = _Axes(chart, number * WIDTH)
        pen.text((axes.left + MARGIN, 14), chart.title, font=large, fill=INK)
        for value in chart.x:
            x, _ = axes.at(value, 1.0)
            pen.line((x, MARGIN, x, HEIGHT - MARGIN), fill=FAINT)
            pen.text((x, HEIGHT - MARGIN + 8), f"{value:,.0f}", font=small, fill=INK, anchor="ma")
        for place, (name, line) in enumerate(chart.lines.items()):
            _line(pen, axes, chart.x, line, COLOURS[place], small)
            pen.text((axes.left + MARGIN, 38 + 15 * place), name, font=small, fill=COLOURS[place])
    page.save(path)


def _line(
    pen: ImageDraw.ImageDraw,
    axes: _Axes,
    x: Sequence[float],
    line: Sequence[float],
    colour: tuple[int, int, int],
    font: ImageFont.ImageFont | ImageFont.FreeTypeFont,
) -> None:
    points = [axes.at(a, b) for a, b in zip(x, line, strict=True)]
    pen.line(points, fill=colour, width=3)
    for (across, up), value in zip(points, line, strict=True):
        pen.ellipse((across - 4, up - 4, across + 4, up + 4), fill=colour)
        pen.text((across, up - 8), f"{value:.3g}", font=font, fill=colour, anchor="mb")
    start, end = axes.at(x[0], line[0]), axes.at(x[-1], line[0] * x[-1] / x[0])
    for step in range(0, 24, 2):
        share = [start[i] + (end[i] - start[i]) * step / 24 for i in (0, 1)]
        until = [start[i] + (end[i] - start[i]) * (step + 1) / 24 for i in (0, 1)]
        if until[1] > MARGIN:
            pen.line((*share, *until), fill=colour)
