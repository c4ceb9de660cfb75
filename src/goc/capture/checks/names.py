"""Checks of the folder: files that no view uses, and files that end too early."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.pixels import Pixels, path_of
from goc.capture.source import Source, View, count_of, shown
from goc.files import is_folder, read_image

_IMAGES = (".png", ".jpg", ".jpeg", ".npy", ".exr", ".tif", ".tiff", ".webp")
_IDS = ("instance", "mask", "segm", "object", "label", "semantic", "ids")
_DEPTH = ("depth",)
_TAIL = 4096


def folder_findings(source: Source, wants_ids: bool, wants_depth: bool) -> Iterator[Finding]:
    """Folders of ids or depth that no view uses, though the user wants ids or depth."""
    root = source.path if is_folder(source.path) else source.path.parent
    used = _used(source)
    parents = Counter(path.parent for path in used)
    has_ids = any(view.ids is not None for view in source.views)
    has_depth = any(view.depth is not None for view in source.views)
    for folder in sorted(entry for entry in root.iterdir() if is_folder(entry)):
        name = folder.name.lower()
        kind = "id" if any(word in name for word in _IDS) else "depth" if any(w in name for w in _DEPTH) else None
        wanted = {"id": wants_ids and not has_ids, "depth": wants_depth and not has_depth}
        if kind is None:
            continue
        files = sorted(file for file in folder.iterdir() if file.suffix.lower() in _IMAGES)
        if files and not parents[folder] and wanted[kind]:
            yield _unused(folder, kind, files, source)
        elif files and parents[folder]:
            left = [file.name for file in files if file not in used]
            if len(left) > 0.1 * len(files) and parents[folder] < len(source.views):
                yield doubt(
                    "files-unused",
                    f"{count_of(left, len(files))} files in {folder.name}/ belong to no view (first: {shown(left[0])})",
                )


def _unused(folder: Path, kind: str, files: list[Path], source: Source) -> Finding:
    """Ids under other names are refused; what is only not listed may be so on purpose."""
    flag = "--capture.no-use-ids" if kind == "id" else "--capture.no-use-depth"
    photographs = [path_of(view.image) for view in source.views]
    listed = {path.stem for path in photographs} & {file.stem for file in files}
    words = (
        f"{folder.name}/ holds {len(files)} images that no view uses (first: {shown(files[0].name)}; photographs: "
        f"{shown(photographs[0].name)} and so on)"
    )
    if listed or kind == "depth":
        return doubt("folder-unused", f"{words}: name them in the capture's file if they belong to it")
    return contradiction("folder-unused", f"{words}. Name them as the photographs, or pass {flag} to leave them out.")


def _used(source: Source) -> set[Path]:
    return {path_of(pixels) for view in source.views for pixels in _all_pixels(view)}


def _all_pixels(view: View) -> list[Pixels]:
    all_kinds = (view.image, view.depth, view.ids, view.normals, view.confidence, view.mask)
    return [pixels for pixels in all_kinds if pixels is not None]


def cut_short(source: Source) -> None:
    """Decode every image that ends as a file does that was cut, so that it is refused now and not after minutes.

    Raises:
        FileError: such an image is damaged.
    """
    for view in source.views:
        for pixels in _all_pixels(view):
            if isinstance(pixels, Path) and _ends_early(pixels):
                read_image(pixels)


def _ends_early(path: Path) -> bool:
    """Whether the mark that ends a PNG or JPEG is missing; False for other files."""
    mark = {".png": b"IEND", ".jpg": b"\xff\xd9", ".jpeg": b"\xff\xd9"}.get(path.suffix.lower())
    if mark is None:
        return False
    try:
        with path.open("rb") as file:
            file.seek(0, 2)
            file.seek(max(0, file.tell() - _TAIL))
            return mark not in file.read()
    except OSError:
        return False
