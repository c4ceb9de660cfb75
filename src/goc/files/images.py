"""Colour, depth and id images.

Pixels come as stored, since poses nearly always refer to stored pixels; `read_picture` turns them upright if asked.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int16, Int32, Shaped, UInt8, UInt16
from PIL import Image, ImageOps

from goc.errors import FileError
from goc.files.atomic import write_bytes
from goc.files.reading import brief, read_bytes, unreadable
from goc.scene import UNLABELLED

MAX_PIXELS = 89_000_000
"""Larger images are refused before they are decoded (just below the size where Pillow begins to object)."""

_FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TIFF")  # not EPS and the like, whose decoders start other programs
_HEIF = (".heic", ".heif", ".hif")
_ORIENTATION = 0x0112
_SIDEWAYS = (5, 6, 7, 8)
"""EXIF orientations that swap width and height."""
_LIMIT = 1 << 30
MILLIMETRES = 1000.0
"""Units per metre of depth images as goc writes them."""


def image_size(path: Path, data: bytes | None = None) -> tuple[int, int]:
    """(width, height) from the header alone.

    Args:
        path: what to read; with `data`, only a name for errors.
        data: the file's content, where it lies in an archive.

    Raises:
        FileError: missing, not an image, or beyond MAX_PIXELS.
    """
    if data is not None:
        return _opened(path, io.BytesIO(data)).size
    try:
        with path.open("rb") as file:
            return _opened(path, file).size
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error


@dataclass(frozen=True)
class PictureSize:
    """(width, height) of an image."""

    stored: tuple[int, int]
    upright: tuple[int, int]
    """After its EXIF orientation is applied."""
    has_alpha: bool


def picture_size(path: Path) -> PictureSize:
    """Sizes from the header alone; raises what `image_size` raises."""
    try:
        with path.open("rb") as file:
            image = _opened(path, file)
            sideways = _orientation(image) in _SIDEWAYS
            upright = image.size[::-1] if sideways else image.size
            return PictureSize(image.size, upright, image.has_transparency_data)
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error


def read_picture(
    path: Path, upright: bool = False, data: bytes | None = None
) -> tuple[UInt8[np.ndarray, "h w 3"], UInt8[np.ndarray, "h w"] | None]:
    """Read a colour image as sRGB, and its alpha channel if it has one.

    Args:
        path: as `read_image`; .heic needs the extra goc[formats].
        upright: apply the EXIF orientation.
        data: the file's content, where it lies in an archive.

    Raises:
        FileError: as `read_image`.
    """
    image = _decoded(path, data)
    if upright:
        image = ImageOps.exif_transpose(image)
    if image.mode.startswith("I") or image.mode == "F":
        return _wide_as_colour(path, image), None
    if not image.has_transparency_data:
        return np.array(image.convert("RGB")), None
    pixels = np.array(image.convert("RGBA"))
    return np.ascontiguousarray(pixels[..., :3]), np.ascontiguousarray(pixels[..., 3])


def read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """Read a colour image as sRGB. Grey and palette images are expanded, transparency is dropped, 16 bits become 8.

    Raises:
        FileError: missing, not an image, damaged, or beyond MAX_PIXELS.
    """
    return read_picture(path)[0]


def read_ids(path: Path) -> Int16[np.ndarray, "h w"]:
    """Read instance ids: a grey or palette image of 8 bits (255 = UNLABELLED) or 16 bits (65535 = UNLABELLED).

    Raises:
        FileError: missing, damaged, coloured, or ids beyond 32767.
    """
    stored = read_channel(path, "an id image")
    if stored.dtype.kind == "f":
        raise FileError(f"{path}: expected an id image, found fractions. Write it as grey PNG.")
    unknown = np.iinfo(stored.dtype).max
    ids = stored.astype(np.int32)
    ids[stored == unknown] = UNLABELLED
    if ids.size and ids.max() > np.iinfo(np.int16).max:
        raise FileError(f"{path}: holds id {ids.max()}, beyond {np.iinfo(np.int16).max}. Number the objects from 1.")
    return ids.astype(np.int16)


def read_codes(
    path: Path, data: bytes | None = None
) -> UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"] | Int32[np.ndarray, "h w"]:
    """Read what an id image stores: grey values, palette indices, or colours as r << 16 | g << 8 | b in int32.

    Args:
        path: what to read; with `data`, only a name for errors.
        data: the file's content, where it lies in an archive.

    Raises:
        FileError: missing, damaged, or fractions.
    """
    image = _decoded(path, data)
    if image.mode in ("RGB", "RGBA", "CMYK", "YCbCr"):
        red, green, blue = np.moveaxis(np.array(image.convert("RGB")).astype(np.int32), -1, 0)
        if not (np.array_equal(red, green) and np.array_equal(red, blue)):
            return red << 16 | green << 8 | blue
        return red.astype(np.uint8)
    codes = _grey(path, image, "an id image")
    if codes.dtype.kind == "f":
        raise FileError(f"{path}: expected an id image, found fractions. Write it as grey PNG.")
    return codes


def read_normals(path: Path) -> Float32[np.ndarray, "h w 3"]:
    """Read unit normals from the colours of an image, n = value / maximum · 2 - 1.

    Of 16 bits a channel, Pillow keeps the upper 8: steps of 0.4°.

    Args:
        path: an 8- or 16-bit RGB image; black = none.

    Returns:
        Unit vectors, NaN = none. Values that are no direction at all (length below 0.5) count as none too.

    Raises:
        FileError: missing, damaged, or grey.
    """
    image = _decoded(path)
    if image.mode not in ("RGB", "RGBA"):
        raise FileError(f"{path}: expected a normal image, found {image.mode} pixels. Write it as an RGB PNG.")
    stored = np.array(image.convert("RGB"))
    vectors = stored.astype(np.float32) * np.float32(2.0 / 255.0) - 1.0
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    known = (stored > 0).any(-1, keepdims=True) & (length > 0.5)
    return np.where(known, vectors / np.maximum(length, 0.5), np.float32(np.nan)).astype(np.float32)


def write_png(
    path: Path, pixels: UInt8[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w"] | UInt16[np.ndarray, "h w"]
) -> None:
    """Write a PNG of 8-bit colour, 8-bit grey or 16-bit grey, atomically."""
    encoded = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, format="PNG", compress_level=4)
    write_bytes(path, encoded.getvalue())


def write_image(path: Path, pixels: UInt8[np.ndarray, "h w 3"]) -> None:
    """Write sRGB colours as JPEG (.jpg, .jpeg: quality 95, colours at full resolution) or PNG, atomically."""
    if path.suffix.lower() not in (".jpg", ".jpeg"):
        return write_png(path, pixels)
    encoded = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(encoded, format="JPEG", quality=95, subsampling=0)
    return write_bytes(path, encoded.getvalue())


def write_normals(path: Path, normals: Float[np.ndarray, "h w 3"]) -> None:
    """Write unit normals, OpenCV camera axes, as 8-bit PNG, atomically: n = value / 255 · 2 - 1, black = none."""
    known = np.isfinite(normals).all(-1, keepdims=True)
    write_png(path, np.where(known, np.rint((np.where(known, normals, 0.0) + 1) * 127.5), 0).astype(np.uint8))


def write_depth(path: Path, depth: Float[np.ndarray, "h w"]) -> None:
    """Write metres as a 16-bit PNG in millimetres, atomically; NaN, and what is beyond 65.535 m, becomes 0 = none."""
    with np.errstate(invalid="ignore"):
        millimetres = np.rint(depth / (1.0 / MILLIMETRES))
        kept = np.where((millimetres > 0) & (millimetres <= np.iinfo(np.uint16).max), millimetres, 0)
    write_png(path, kept.astype(np.uint16))


def write_ids(path: Path, ids: Int16[np.ndarray, "h w"]) -> None:
    """Write instance ids atomically: 8 bits while ids stay below 255, else 16; UNLABELLED becomes 255 or 65535."""
    stored_as = np.uint8 if ids.size == 0 or ids.max() < 255 else np.uint16
    write_png(path, np.where(ids == UNLABELLED, np.iinfo(stored_as).max, ids).astype(stored_as))


def _opened(path: Path, file: io.BufferedIOBase) -> Image.Image:
    """Header parsed, pixels not yet decoded."""
    if path.suffix.lower() in _HEIF:
        return _heif(path, file)
    try:
        image = Image.open(file, formats=_FORMATS)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise FileError(f"{path}: {brief(error)}. Scale the capture down.") from error
    except Exception as error:  # Pillow raises a dozen types on damaged headers
        raise FileError(f"{path}: not a readable {', '.join(_FORMATS)} image. Write it again.") from error
    if image.width * image.height > MAX_PIXELS:
        size = f"{image.width} x {image.height}"
        raise FileError(f"{path}: {size} pixels, more than {MAX_PIXELS // 10**6} million. Scale the capture down.")
    return image


def _decoded(path: Path, data: bytes | None = None) -> Image.Image:
    image = _opened(path, io.BytesIO(read_bytes(path, _LIMIT) if data is None else data))
    try:
        image.load()
    except Exception as error:  # Pillow raises a dozen types on damaged data
        raise FileError(f"{path}: damaged or cut short ({brief(error)}). Copy or write it again.") from error
    return image


def _wide(path: Path, image: Image.Image) -> UInt16[np.ndarray, "h w"]:
    values = np.asarray(image)
    if values.size and (values.min() < 0 or values.max() > np.iinfo(np.uint16).max):
        raise FileError(f"{path}: holds values beyond 16 bits. Write it as a 16-bit PNG.")
    return values.astype(np.uint16)


def _heif(path: Path, file: io.BufferedIOBase) -> Image.Image:
    """A phone's photograph. The decoder applies the turn that the file asks for, as all programs do."""
    try:
        import pi_heif  # pyright: ignore[reportMissingImports]  # an extra
    except ImportError as error:
        raise FileError(f"{path}: pi-heif is not installed. pip install 'goc[formats]', or convert to JPEG.") from error
    try:
        decoded: Any = pi_heif.open_heif(file, convert_hdr_to_8bit=True)
        return decoded.to_pillow()
    except Exception as error:  # libheif's own errors
        raise FileError(f"{path}: not a readable HEIC image ({brief(error)}). Copy or write it again.") from error


def _orientation(image: Image.Image) -> int:
    try:
        return image.getexif().get(_ORIENTATION, 1)
    except Exception:  # damaged EXIF is no reason to refuse the pixels
        return 1


def _wide_as_colour(path: Path, image: Image.Image) -> UInt8[np.ndarray, "h w 3"]:
    """16-bit grey, which Pillow would clip."""
    grey = _wide(path, image)
    return np.repeat((grey >> 8).astype(np.uint8)[..., None], 3, 2)


def read_channel(path: Path, what: str) -> Shaped[np.ndarray, "h w"]:
    """The stored numbers of a grey or palette image: uint8, uint16, or float32 of a TIFF; equal channels are grey.

    Raises:
        FileError: missing, damaged, or coloured.
    """
    return _grey(path, _decoded(path), what)


def _grey(path: Path, image: Image.Image, what: str) -> Shaped[np.ndarray, "h w"]:
    if image.mode.startswith("I"):
        return _wide(path, image)
    if image.mode == "F":
        return np.asarray(image, np.float32)
    values = np.array(image).astype(np.uint8)  # mode 1 comes as bool, P as palette indices
    if image.mode in ("1", "L", "P"):
        return values
    colour = values[..., :1] if image.mode in ("LA", "PA") else values[..., :3]
    if image.mode not in ("LA", "PA", "RGB", "RGBA") or (colour != colour[..., :1]).any():
        raise FileError(f"{path}: expected {what} with one channel, found {image.mode} colours. Write it as grey PNG.")
    return np.ascontiguousarray(colour[..., 0])
