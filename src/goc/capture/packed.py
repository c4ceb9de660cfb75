"""Images inside larger files: ZIP archives and recordings. They are decoded where they lie; nothing is unpacked."""

import stat
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from jaxtyping import Shaped

from goc.capture.source import shown
from goc.errors import FileError
from goc.files import image_size, read_codes, read_picture

Packing = Literal["none", "deflate", "zlib", "lzfse", "lz4"]
"""How bytes are compressed: deflate has no header, zlib has one; lzfse is Apple's, lz4 one block without a frame."""
_MOST_ENTRIES = 500_000
_LARGEST = 1 << 30
_SLACK = 4096
_ZIP_PACKINGS: dict[int, Packing] = {zipfile.ZIP_STORED: "none", zipfile.ZIP_DEFLATED: "deflate"}


@dataclass(frozen=True)
class Extent:
    """A piece of a file."""

    path: Path
    name: str
    """What errors call the piece."""
    offset: int
    length: int
    """Bytes in the file."""
    size: int
    """Bytes after unpacking; no more are ever unpacked."""
    packing: Packing = "none"

    @property
    def label(self) -> Path:
        """The piece as if it were a file in a folder, for errors."""
        return self.path / self.name

    def read(self) -> bytes:
        """Read and unpack.

        Raises:
            FileError: the file ends before, the data are damaged or of another size, or a library is not installed.
        """
        try:
            with self.path.open("rb") as file:
                file.seek(self.offset)
                data = file.read(self.length)
        except OSError as error:
            raise FileError(f"{self.path}: cannot be read ({error.strerror}). Check the path.") from error
        if len(data) < self.length:
            raise FileError(f"{self.label}: cut short. Copy or export {self.path.name} again.")
        return _sized(self, unpack(self.label, self.packing, data, self.size))


@dataclass(frozen=True)
class Repacked:
    """A piece that is compressed once more inside another."""

    within: Extent
    size: int
    packing: Packing

    @property
    def path(self) -> Path:
        """The file that it is a piece of."""
        return self.within.path

    @property
    def label(self) -> Path:
        """The piece as if it were a file in a folder, for errors."""
        return self.within.label

    def read(self) -> bytes:
        """Read and unpack; raises what `Extent.read` raises."""
        return _sized(self, unpack(self.label, self.packing, self.within.read(), self.size))


def unpack(label: Path, packing: Packing, data: bytes, size: int) -> bytes:
    """Decompress.

    Args:
        label: what errors call the data.
        packing: how they are compressed.
        data: compressed.
        size: bytes that are expected; much more is not made of them.

    Raises:
        FileError: the data are damaged, or a library is not installed.
    """
    try:
        match packing:
            case "none":
                return data
            case "deflate":
                return zlib.decompressobj(-zlib.MAX_WBITS).decompress(data, size + 1)
            case "zlib":
                return zlib.decompressobj().decompress(data, size + 1)
            case "lzfse":
                return _lzfse(data, size)
            case "lz4":
                return _library("lz4.block").decompress(data, uncompressed_size=size)
    except FileError:
        raise
    except Exception as error:  # each library has its own
        text = f"{label}: damaged ({error or 'not ' + packing})"
        raise FileError(f"{text}. Copy or export it again.") from error


def _lzfse(data: bytes, size: int) -> bytes:
    """The library takes no bound: the first block says how much it makes, and no data make 300 times as much."""
    first = int.from_bytes(data[4:8], "little")
    if first > size or len(data) > 2 * size + _SLACK:
        raise ValueError(f"makes {first:,} bytes, not {size:,}")
    return _library("lzfse").decompress(data)


def _sized(extent: "Extent | Repacked", data: bytes) -> bytes:
    if len(data) != extent.size:
        text = f"{extent.label}: {len(data):,} bytes, not the expected {extent.size:,}"
        raise FileError(f"{text}. Copy or export {extent.path.name} again.")
    return data


def _library(name: str) -> Any:
    """A decompressor of the extra goc[phones]; it is C, so that memory stays within bounds is its own concern."""
    try:
        module = __import__(name, fromlist=["decompress"])
    except ImportError as error:
        package = name.split(".")[0]
        raise FileError(f"{package} is not installed, which these files need: pip install 'goc[phones]'.") from error
    return module


@dataclass(frozen=True)
class PackedPicture:
    """A photograph, or an image of ids, in one of the usual formats."""

    extent: Extent
    codes: bool = False
    """It holds ids."""

    @property
    def path(self) -> Path:
        """The file that it is a piece of."""
        return self.extent.path

    def size(self) -> tuple[int, int]:
        """Width and height; raises FileError."""
        return image_size(self.extent.label, self.extent.read())

    def read(self) -> Shaped[np.ndarray, "..."]:
        """Decode; raises FileError."""
        if self.codes:
            return read_codes(self.extent.label, self.extent.read())
        colours, alpha = read_picture(self.extent.label, data=self.extent.read())
        return colours if alpha is None else np.concatenate([colours, alpha[..., None]], -1)


@dataclass(frozen=True)
class PackedNumbers:
    """Numbers by rows: depth, confidence, or a photograph that is not compressed."""

    extent: Extent | Repacked
    shape: tuple[int, ...]
    """Height, width, and channels where there are several."""
    dtype: str
    """As NumPy writes it: "<u2", "<f4"."""

    @property
    def path(self) -> Path:
        """The file that they are a piece of."""
        return self.extent.path

    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.shape[1], self.shape[0]

    def read(self) -> Shaped[np.ndarray, "..."]:
        """Decode; raises FileError."""
        return np.array(np.frombuffer(self.extent.read(), self.dtype)).reshape(self.shape)


def zip_extents(archive: Path, wanted: Callable[[str], bool]) -> dict[str, Extent]:
    """Where the files of a ZIP archive lie that are wanted.

    Raises:
        FileError: not a ZIP archive, damaged, encrypted, a file in it is beyond 1 GiB, or its name would lead out of
            a folder.
    """
    try:
        with zipfile.ZipFile(archive) as packed:
            entries = [entry for entry in packed.infolist() if not entry.is_dir() and wanted(entry.filename)]
    except FileNotFoundError as error:
        raise FileError(f"{archive}: not found. Check the path.") from error
    except (OSError, ValueError, zipfile.BadZipFile, NotImplementedError, struct.error) as error:
        raise FileError(f"{archive}: not a readable ZIP archive ({error}). Copy or export it again.") from error
    if len(entries) > _MOST_ENTRIES:
        raise FileError(f"{archive}: {len(entries):,} files, which no capture has. Check the archive.")
    with archive.open("rb") as file:
        return {entry.filename: _extent(archive, entry, file.seek, file.read) for entry in entries}


def _extent(archive: Path, entry: zipfile.ZipInfo, seek: Callable[[int], int], read: Callable[[int], bytes]) -> Extent:
    name = entry.filename
    parts = PurePosixPath(name).parts
    leaves = name.startswith("/") or ".." in parts or "\\" in name or "\0" in name
    if leaves or stat.S_ISLNK(entry.external_attr >> 16):
        raise FileError(f"{archive}: {shown(name)} leads out of the archive. Do not trust it.")
    packing = _ZIP_PACKINGS.get(entry.compress_type)
    if packing is None or entry.flag_bits & 1 or max(entry.file_size, entry.compress_size) > _LARGEST:
        text = f"{archive}: {shown(name)} is encrypted, beyond 1 GiB, or compressed in a way that goc does not know"
        raise FileError(f"{text}. Unpack and zip it again.")
    seek(entry.header_offset)
    header = read(30)  # its last two numbers are lengths of what stands between it and the data
    if len(header) < 30 or header[:4] != b"PK\3\4":
        raise FileError(f"{archive}: {shown(name)} is not where the archive says. Copy or export it again.")
    between = sum(struct.unpack("<2H", header[26:30]))
    offset = entry.header_offset + 30 + between
    return Extent(archive, name, offset, entry.compress_size, entry.file_size, packing)
