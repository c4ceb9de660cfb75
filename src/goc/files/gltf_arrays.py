"""Accessors of a glTF file as plain arrays: sparse, normalised, quantised or compressed ones included."""

from typing import Any

import numpy as np
from jaxtyping import Float32, Shaped

from goc.errors import FileError
from goc.files.gltf_buffers import Gltf, GltfError, whole

DRACO = "KHR_draco_mesh_compression"
_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class Accessors:
    """Decodes accessors, each once, within the file's allowance."""

    def __init__(self, gltf: Gltf) -> None:
        self._gltf, self._left = gltf, gltf.allowance
        self._known: dict[int, np.ndarray] = {}

    def numbers(self, index: object) -> Shaped[np.ndarray, "n w"]:
        """An accessor's numbers as they are stored, sparse ones put in."""
        assert isinstance(index, int)
        if index not in self._known:
            entry = self._gltf.entry("accessors", index)
            self._known[index] = self._sparse(entry, self._dense(entry))
        return self._known[index]

    def values(self, index: object) -> Float32[np.ndarray, "n w"]:
        """An accessor's numbers as they are meant: normalised integers span [0, 1], or [-1, 1]."""
        return meant(self.numbers(index), bool(self._gltf.entry("accessors", index).get("normalized", False)))

    def spend(self, size: int) -> None:
        """Account for bytes to be decoded.

        Raises:
            GltfError: more than the file may take.
        """
        self._left -= size
        if self._left < 0:
            raise GltfError(f"its arrays take more than {self._gltf.allowance:,} bytes, out of a much smaller file")

    def shape(self, index: object) -> tuple[int, int, np.dtype]:
        """Rows, columns and type that an accessor announces."""
        entry = self._gltf.entry("accessors", index)
        kind, width = _DTYPES.get(entry.get("componentType", 0)), _WIDTHS.get(str(entry.get("type")))
        if kind is None or width is None:
            raise GltfError(f"an accessor of unknown type {str(entry.get('componentType'))[:20]!r}")
        return whole(entry, "count"), width, np.dtype(kind)

    def _dense(self, entry: dict[str, Any]) -> Shaped[np.ndarray, "n w"]:
        count, width, kind = self.shape(self._gltf.entries("accessors").index(entry))
        self.spend(count * width * kind.itemsize)
        if "bufferView" not in entry:
            if "sparse" not in entry:
                raise GltfError("an accessor without content")
            return np.zeros((count, width), kind)
        data, stride = self._gltf.view(entry["bufferView"])
        return _rows(data, whole(entry, "byteOffset", 0), stride, (count, width), kind)

    def _sparse(self, entry: dict[str, Any], dense: Shaped[np.ndarray, "n w"]) -> Shaped[np.ndarray, "n w"]:
        sparse = entry.get("sparse")
        if sparse is None:
            return dense
        count, where, what = whole(sparse, "count"), sparse["indices"], sparse["values"]
        kind = _DTYPES.get(where.get("componentType", 0), "<u4")
        data, _ = self._gltf.view(where.get("bufferView"))
        rows = _rows(data, whole(where, "byteOffset", 0), None, (count, 1), np.dtype(kind))[:, 0].astype(np.int64)
        if len(rows) and (rows.min() < 0 or rows.max() >= len(dense)):
            raise GltfError("a sparse accessor that changes rows which are not there")
        data, _ = self._gltf.view(what.get("bufferView"))
        result = dense.copy()
        result[rows] = _rows(data, whole(what, "byteOffset", 0), None, (count, dense.shape[1]), dense.dtype)
        return result


def meant(stored: Shaped[np.ndarray, "n w"], normalised: bool) -> Float32[np.ndarray, "n w"]:
    """Numbers as floats; of normalised integers the largest is 1."""
    if stored.dtype.kind == "f" or not normalised:
        return stored.astype(np.float32)
    most = np.iinfo(stored.dtype).max
    return np.maximum(stored.astype(np.float64) / most, -1.0).astype(np.float32)


def unpack_draco(gltf: Gltf, accessors: Accessors, primitive: dict[str, Any]) -> dict[str, np.ndarray]:
    """Attributes, and `indices`, of a primitive that Draco compressed; needs the extra `formats`.

    Raises:
        FileError: the extra is missing.
        GltfError: not a sound Draco buffer.
    """
    packed = primitive["extensions"][DRACO]
    try:
        import DracoPy  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise FileError(
            f"{gltf.path}: its meshes are compressed by Draco. Run `pip install goc[formats]`, or export it without."
        ) from error
    indices = primitive.get("indices")
    attributes = primitive.get("attributes", {})
    for index in (*attributes.values(), *([] if indices is None else [indices])):
        count, width, kind = accessors.shape(index)
        accessors.spend(count * width * max(kind.itemsize, 4))
    try:
        decoded = DracoPy.decode(gltf.view(packed.get("bufferView"))[0])
        found = {one["unique_id"]: np.asarray(one["data"]) for one in decoded.attributes}
        faces = np.asarray(getattr(decoded, "faces", np.zeros((0, 3), np.uint32)))
    except Exception as error:  # the library raises its own kinds, and numpy's
        raise GltfError(f"its Draco buffer cannot be decoded ({error})") from error
    result = {}
    for name, number in packed.get("attributes", {}).items():
        count, width, _ = accessors.shape(attributes.get(name))
        values = found.get(number)
        if values is None or values.size != count * width:
            raise GltfError(f"its Draco buffer holds another {str(name)[:20]} than announced")
        normalised = bool(gltf.entry("accessors", attributes[name]).get("normalized", False))
        result[name] = meant(values.reshape(count, width), normalised)
    return result | {"indices": faces.reshape(-1, 1)}


def _rows(
    data: bytes, start: int, stride: int | None, shape: tuple[int, int], kind: np.dtype
) -> Shaped[np.ndarray, "n w"]:
    """Rows that begin `stride` bytes apart, or one after the other."""
    count, width = shape
    size = width * kind.itemsize
    step = stride or size
    if not isinstance(step, int) or step < size or (count and start + (count - 1) * step + size > len(data)):
        raise GltfError(f"cut short: an accessor of {count:,} rows in a view of {len(data):,} bytes")
    if not count:
        return np.zeros(shape, kind)
    return np.ndarray(shape, kind, data, start, (step, kind.itemsize)).copy()
