"""Which reader a path belongs to."""

from pathlib import Path

from goc.capture.assemble import assemble
from goc.capture.checks import check_capture
from goc.capture.config import CaptureConfig
from goc.capture.convention import restated
from goc.capture.readers import FORMATS, RECORDINGS, Reader
from goc.capture.source import Source
from goc.errors import CaptureError
from goc.events import Listener, ignore
from goc.files import is_file, is_folder
from goc.scene import Capture

_SHOWN = 6


def load_capture(path: Path, config: CaptureConfig | None = None, notify: Listener = ignore) -> Capture:
    """Read a folder of posed images and check that its numbers mean what they say.

    Images are decoded later, when asked for, apart from a few that are checked.

    Args:
        path: a folder of any format of FORMATS, or a transforms file itself (transforms_sparse.json).
        config: default settings if None.
        notify: hears of everything that was left out.

    Returns:
        Pinhole views (distortion is undone while decoding), OpenCV camera axes, depth in scene units
        unless its kind says otherwise.

    Raises:
        CaptureError: files contradict each other, are missing, or nothing here is a capture; or its views do not
            agree with each other (`goc.capture.checks`).
        FileError: one file is malformed. Damaged pixels may show only when that view is decoded.
    """
    config = config or CaptureConfig()
    source = read_source(path, config, notify)
    capture = assemble(source, config, notify)
    check_capture(source, capture, config, notify)
    return capture


def read_source(path: Path, config: CaptureConfig, notify: Listener = ignore) -> Source:
    """Files and cameras of a capture, as the user says that they are meant; raises what `load_capture` raises."""
    return restated(reader_of(path).read(path, config, notify), config.convention)


def reader_of(path: Path) -> Reader:
    """The reader of a path's format; raises CaptureError where it has none."""
    reader = next((reader for reader in FORMATS if reader.detect(path)), None)
    if reader is None:
        raise CaptureError(_nothing_found(path))
    return reader


def _nothing_found(path: Path) -> str:
    if is_file(path):
        return f"{path}: is a file, but not a transforms .json. Give the folder of the capture."
    if not is_folder(path):
        return f"{path}: not found. Give the folder of a capture."
    names = sorted(entry.name + "/" * is_folder(entry) for entry in path.iterdir())
    shown = ", ".join(names[:_SHOWN]) + (f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else "")
    tools = ", or ".join(reader.expects for reader in FORMATS if reader not in RECORDINGS)
    others = ", ".join(reader.name for reader in RECORDINGS)
    return f"{path}: no capture here. Looked for {tools}, or {others}; found {shown or 'nothing'}.{_hint(names)}"


def _hint(names: list[str]) -> str:
    others = [name for name in names if name.startswith("transforms") and name.endswith(".json")]
    if others:
        return f" Give the file itself, such as {others[0]}."
    if "sparse/" in names:
        return " sparse/ lacks cameras or images, .bin or .txt: copy the whole COLMAP model."
    if "color/" in names:
        return " Single views without pose/ cannot be carved."
    return " Photographs without poses need structure from motion first (COLMAP, ns-process-data)."
