"""Named tensors in one file: the checkpoint layer. safetensors, since a pickle runs code when read."""

from collections.abc import Mapping
from pathlib import Path

import msgspec
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor

from goc.errors import FileError
from goc.files.atomic import write_atomic
from goc.files.reading import brief, is_file

_LENGTH = 8  # bytes that say how long the header is


def write_tensors(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str] | None = None) -> None:
    """Write tensors and a little text atomically. The same content gives the same bytes."""
    plain = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    data = memoryview(save(plain, dict(metadata or {})))
    body = _LENGTH + int.from_bytes(data[:_LENGTH], "little")
    # the library keeps metadata in a hash map, whose order differs from run to run
    header = msgspec.json.encode(msgspec.json.decode(data[_LENGTH:body]), order="sorted")
    header += b" " * (-len(header) % _LENGTH)  # keeps the numbers aligned; offsets count from the end of the header
    with write_atomic(path) as file:
        file.write(len(header).to_bytes(_LENGTH, "little") + header)
        file.write(data[body:])


def read_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, str]]:
    """Read what `write_tensors` wrote: (tensors, metadata), on the CPU.

    Raises:
        FileError: missing, or damaged so that sizes and header contradict each other.
    """
    if not is_file(path):
        raise FileError(f"{path}: not found. Check the path.")
    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            # clone: the file stays mapped otherwise, and a later overwrite could change the numbers
            tensors = {name: file.get_tensor(name).clone() for name in file.keys()}  # noqa: SIM118
            return tensors, dict(file.metadata() or {})
    except (SafetensorError, OSError, RuntimeError, ValueError, TypeError, AttributeError) as error:
        raise FileError(f"{path}: not a readable safetensors file ({brief(error)}). Write it again.") from error
