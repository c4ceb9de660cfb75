"""A page to put pictures and captions on."""

import unicodedata

import numpy as np
from jaxtyping import UInt8
from PIL import Image, ImageDraw, ImageFont

INK = (34, 36, 40)
FAINT = (112, 115, 122)
ALARM = (176, 74, 16)
_PAPER = (250, 250, 248)
_FONT_GLYPHS = frozenset(map(chr, range(32, 127))) | frozenset("·…")
"""What Pillow's built-in font can draw, of what goc writes."""


class Canvas:
    """A white page of fixed size; places are pixels from the top left corner."""

    def __init__(self, width: int, height: int) -> None:
        """Make an empty page."""
        self._page = Image.new("RGB", (width, height), _PAPER)
        self._draw = ImageDraw.Draw(self._page)

    def picture(self, pixels: UInt8[np.ndarray, "h w 3"], x: int, y: int, width: int, height: int) -> None:
        """Fit a picture into a box, centred, keeping its proportions."""
        image = Image.fromarray(np.ascontiguousarray(pixels))
        scale = min(width / image.width, height / image.height)
        size = (max(1, round(image.width * scale)), max(1, round(image.height * scale)))
        if size != image.size:
            image = image.resize(size, Image.Resampling.LANCZOS)
        self._page.paste(image, (x + (width - size[0]) // 2, y + (height - size[1]) // 2))

    def text(
        self, words: str, x: int, y: int, size: int, width: int = 100_000, colour: tuple[int, int, int] = INK
    ) -> int:
        """Write one line, cut with … where it is wider than `width`; returns its width."""
        font = ImageFont.load_default(size)
        line = plain(words)
        while len(line) > 1 and font.getlength(line) > width:
            line = line[:-2].rstrip() + "…"
        self._draw.text((x, y), line, font=font, fill=colour)
        return round(font.getlength(line))

    def chip(self, x: int, y: int, size: int, colour: tuple[int, int, int]) -> None:
        """Draw a small rounded square."""
        self._draw.rounded_rectangle((x, y, x + size, y + size), radius=size // 4, fill=colour)

    def pixels(self) -> UInt8[np.ndarray, "h w 3"]:
        """What the page shows now."""
        return np.array(self._page)


def plain(words: str) -> str:
    """Letters that the font has: accents are dropped, anything else becomes "?"."""
    bare = (c for c in unicodedata.normalize("NFKD", words) if not unicodedata.combining(c))
    return "".join(c if c in _FONT_GLYPHS else "?" for c in bare)
