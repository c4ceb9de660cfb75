"""Source → Capture: the checks that every format needs, and lazy decoding."""

from dataclasses import replace

import numpy as np

from goc.capture.config import CaptureConfig
from goc.capture.decode import CutOuts, are_cut_out, camera_of, check_shape, is_turned, layers
from goc.capture.distortion import looks_of
from goc.capture.masks import understood
from goc.capture.offset import offset_of, points_without, without_offset
from goc.capture.pixels import is_there, path_of, size_of
from goc.capture.scale import guess_units_per_metre
from goc.capture.source import Lens, Source, View, complain, count_of, shown
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.scene import Camera, Capture, ViewCache

_STAGE = "capture"
_SIDE_IMAGES = {"depth": "depth images", "ids": "id images", "normals": "normal images", "mask": "masks"}
_PIXEL = 1.0
"""Sides of a scaled image may be rounded by so many pixels."""
_MIDDLE = 0.02
_CENTRAL = 0.15
"""A principal point farther from the middle, as a share of the side, is of another size than the file says."""


def assemble(source: Source, config: CaptureConfig, notify: Listener) -> Capture:
    """Check a reader's views against their files and make a capture of them.

    Raises:
        CaptureError: files are missing, sizes contradict the intrinsics, or two views are one.
        FileError: an image's header is damaged.
    """
    views = _with_images(source, config, notify)
    _check_names(source, views)
    kind = config.depth_kind or source.depth_kind
    measured = kind in ("metric", "distance") and any(view.depth is not None for view in views)
    views = tuple(_wanted(view, config) for view in views)
    views = _with_side_images(source, views, config, notify)
    views = _of_image_size(source, views, notify)
    _check_headers(views)
    images = [view.ids for view in views if view.ids is not None]
    if images:
        source = replace(source, id_codes=understood(source.path, images, source.id_codes, notify))
    cut_out = config.use_ids and not images and _are_cut_out(views, notify)
    views = _cut(source, views, notify)
    offset = offset_of([view.world_from_cam for view in views])
    views = without_offset(source.path, views, offset, notify)
    cameras = _cameras(source, views, config)
    scan = None if source.scan is None else source.scan.wanted(config.use_depth, config.use_ids, offset)
    frames = layers(replace(source, scan=scan), views, cameras, kind)
    metric = measured if source.metric is None else source.metric
    guessed = 1.0 if metric else guess_units_per_metre([view.world_from_cam for view in views])
    return Capture(
        cameras=cameras,
        view_names=tuple(view.name for view in views),
        frames=ViewCache(CutOuts(below=frames) if cut_out else frames, config.cache_mb << 20),
        has_depth=any(view.depth is not None for view in views) or (scan is not None and scan.depth),
        has_ids=cut_out or bool(images) or (scan is not None and scan.ids is not None),
        depth_kind="metric" if kind == "distance" else kind,
        points=points_without(source.points, offset),
        id_names=source.id_names if config.use_ids else {},
        units_per_metre=guessed if config.units_per_metre is None else config.units_per_metre,
        metric=metric or config.units_per_metre is not None,
        up=source.up,
        offset=offset,
    )


def _are_cut_out(views: tuple[View, ...], notify: Listener) -> bool:
    """Whether ids come from transparency, which is said."""
    found = are_cut_out(views)
    if found:
        notify(Warned(stage=_STAGE, message="Photographs are cut out: what is opaque is taken for one object, id 1"))
    return found


def _cameras(source: Source, views: tuple[View, ...], config: CaptureConfig) -> tuple[Camera, ...]:
    try:
        return tuple(camera_of(view, config.max_side_px) for view in views)
    except CaptureError as error:
        raise CaptureError(f"{source.path}: {error}. Check k1 to k4, p1 and p2.") from error


def _cut(source: Source, views: tuple[View, ...], notify: Listener) -> tuple[View, ...]:
    """The views, those of very wide lenses cut into the faces of a cube."""
    cut: list[View] = []
    for view in views:
        looks = looks_of(view.lens)
        if not looks:
            raise CaptureError(f"{source.path}: the lens of {shown(view.name)} sees nothing. Check its intrinsics.")
        for name, lens in looks.items():
            turn = np.eye(4)
            if lens.turn is not None:
                turn[:3, :3] = np.reshape(lens.turn, (3, 3))
            label = f"{view.name} ({name})" if name else view.name
            cut.append(replace(view, name=label, lens=lens, world_from_cam=view.world_from_cam @ turn))
    if len(cut) > len(views):
        wide = sum(len(looks_of(view.lens)) > 1 for view in views)
        message = f"{wide} of {len(views)} views see more than a pinhole can: cut into {len(cut)} views"
        notify(Warned(stage=_STAGE, message=message))
    return tuple(cut)


def _of_image_size(source: Source, views: tuple[View, ...], notify: Listener) -> tuple[View, ...]:
    """Views whose intrinsics are for the size of the image; those of a scaled copy are scaled along."""
    fitting, scaled, wrong, swapped = [], [], [], []
    sizes = [_image_size(view) for view in views]
    fits = {view.lens for view, size in zip(views, sizes, strict=True) if size == (view.lens.width, view.lens.height)}
    for view, size in zip(views, sizes, strict=True):
        as_stated = size == (view.lens.width, view.lens.height)  # always so where sides are equal
        turned = not as_stated and size == (view.lens.height, view.lens.width)
        if turned and view.lens in fits and _is_symmetric(view.lens):
            view = replace(view, lens=_on_its_side(view.lens))
            swapped.append(view.name)
        lens = view.lens
        if size != (lens.width, lens.height):
            is_copy = _is_scaled(lens, *size)
            text = f"{view.name} has {size[0]} x {size[1]}, expected {lens.width} x {lens.height}"
            (scaled if is_copy else wrong).append(text)
            view = replace(view, lens=lens.resized(*size)) if is_copy else view
        fitting.append(view)
    if wrong:
        remedy = "Scale the images or the intrinsics; where sides are swapped, rotate the pixels as EXIF says."
        raise complain(source.path, wrong, len(views), "images are not of the size of their intrinsics", remedy)
    if swapped:
        counted = count_of(swapped, len(views))
        message = f"{counted} images lie on their side: intrinsics are turned along, poses are taken as they are"
        notify(Warned(stage=_STAGE, message=f"{message} (first: {shown(swapped[0])})"))
    if scaled:
        counted = count_of(scaled, len(views))
        message = f"{counted} images are scaled copies: intrinsics are scaled along (first: {shown(scaled[0])})"
        notify(Warned(stage=_STAGE, message=message))
    return tuple(fitting)


def _is_symmetric(lens: Lens) -> bool:
    """Whether turning the image either way gives the same intrinsics, within two pixels in a hundred."""
    x, y = lens.centre_px[0] / lens.width, lens.centre_px[1] / lens.height
    return max(abs(x - 0.5), abs(y - 0.5)) < _MIDDLE and not any((*lens.tangential, *lens.prism))


def _on_its_side(lens: Lens) -> Lens:
    """The lens of the same camera held upright; the principal point's small shift could turn either way: dropped."""
    centre = (lens.height / 2, lens.width / 2)
    return replace(lens, width=lens.height, height=lens.width, focal_px=lens.focal_px[::-1], centre_px=centre)


def _is_scaled(lens: Lens, width: int, height: int) -> bool:
    """Whether an image is as a whole a smaller or larger copy of what the intrinsics are of."""
    across, down = width / lens.width, height / lens.height
    whole = abs(across - down) * min(lens.width, lens.height) <= _PIXEL * max(across, down, 1.0)
    x, y = lens.centre_px[0] / lens.width, lens.centre_px[1] / lens.height
    return whole and max(abs(x - 0.5), abs(y - 0.5)) < _CENTRAL


def _image_size(view: View) -> tuple[int, int]:
    """Of the pixels that the intrinsics are of: stored, or upright where only those fit."""
    path = view.image
    if path_of(path) is path and is_turned(path_of(path), view.lens):
        return view.lens.width, view.lens.height
    return size_of(path)


def _wanted(view: View, config: CaptureConfig) -> View:
    """The view with what the user does not want left out."""
    return replace(
        view,
        depth=view.depth if config.use_depth else None,
        ids=view.ids if config.use_ids else None,
        normals=view.normals if config.use_normals else None,
    )


def _with_images(source: Source, config: CaptureConfig, notify: Listener) -> tuple[View, ...]:
    if not source.views:
        raise CaptureError(f"{source.path}: lists no views. Check that the capture is complete.")
    missing = [view.name for view in source.views if not is_there(view.image)]
    if missing and not config.allow_missing:
        remedy = "Add them, or pass --capture.allow-missing to leave them out."
        raise complain(source.path, missing, len(source.views), "images are missing", remedy)
    if len(missing) == len(source.views):
        raise complain(source.path, missing, len(source.views), "images are missing", "Check the folder.")
    if missing:
        counted = count_of(missing, len(source.views))
        notify(Warned(stage=_STAGE, message=f"{counted} images are missing and left out (first: {shown(missing[0])})"))
    return tuple(view for view in source.views if view.name not in set(missing))


def _with_side_images(
    source: Source, views: tuple[View, ...], config: CaptureConfig, notify: Listener
) -> tuple[View, ...]:
    """Check that the depth, id and normal images that the capture names are there."""
    for kind, what in _SIDE_IMAGES.items():
        named = [view for view in views if getattr(view, kind) is not None]
        missing = [view.name for view in named if not is_there(getattr(view, kind))]
        if missing and not config.allow_missing:
            unused = "" if kind == "mask" else f" or --capture.no-use-{kind}"
            remedy = f"Add them, or pass --capture.allow-missing{unused}."
            raise complain(source.path, missing, len(named), f"{what} are missing", remedy)
        there = len(named) - len(missing)
        if 0 < there < len(views) or missing:
            notify(Warned(stage=_STAGE, message=f"{len(views) - there} of {len(views)} views have no {what}"))
        absent = set(missing)
        views = tuple(replace(view, **{kind: None}) if view.name in absent else view for view in views)
    return views


def _check_names(source: Source, views: tuple[View, ...]) -> None:
    seen: set[str] = set()
    doubled = []
    for view in views:
        if view.name in seen:
            doubled.append(view.name)
        seen.add(view.name)
    if doubled:
        raise complain(source.path, doubled, len(views), "views name an image twice", "Keep one entry of each.")


def _check_headers(views: tuple[View, ...]) -> None:
    """Compare sizes in the files' headers with the image's; pixels are not decoded."""
    for view in views:
        rasters = [view.ids, view.normals, view.mask, *([view.depth] if view.depth_lens is None else [])]
        for pixels in rasters:
            if pixels is not None:
                check_shape(path_of(pixels), *size_of(pixels), view.lens)
