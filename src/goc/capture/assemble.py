"""Source → Capture: the checks that every format needs, and lazy decoding."""

from dataclasses import replace

from goc.capture.config import CaptureConfig
from goc.capture.decode import Photographs, WithDepth, WithIds, WithNormals, camera_of, check_shape
from goc.capture.scale import guess_units_per_metre
from goc.capture.source import Source, View, complain, count_of, shown
from goc.errors import CaptureError
from goc.events import Listener, Warned
from goc.files import image_size, is_file
from goc.scene import Camera, Capture, FrameSource, ViewCache

_STAGE = "capture"


def assemble(source: Source, config: CaptureConfig, notify: Listener) -> Capture:
    """Check a reader's views against their files and make a capture of them.

    Raises:
        CaptureError: files are missing, sizes contradict the intrinsics, or two views are one.
        FileError: an image's header is damaged.
    """
    views = _with_images(source, config, notify)
    _check_names(source, views)
    kind = config.depth_kind or source.depth_kind
    measured = kind == "metric" and any(view.depth is not None for view in views)
    views = tuple(_wanted(view, config) for view in views)
    views = _with_side_images(source, views, config, notify)
    _check_headers(source, views)
    try:
        cameras = tuple(camera_of(view, config.max_side_px) for view in views)
    except CaptureError as error:
        raise CaptureError(f"{source.path}: {error}. Check k1 to k4, p1 and p2.") from error
    units_per_metre = config.units_per_metre
    if units_per_metre is None:
        units_per_metre = 1.0 if measured else guess_units_per_metre([view.world_from_cam for view in views])
    return Capture(
        cameras=cameras,
        view_names=tuple(view.name for view in views),
        frames=ViewCache(_layers(source, views, cameras), config.cache_mb << 20),
        has_depth=any(view.depth is not None for view in views),
        has_ids=any(view.ids is not None for view in views),
        depth_kind=kind,
        points=source.points,
        id_names=source.id_names if config.use_ids else {},
        units_per_metre=units_per_metre,
        metric=measured or config.units_per_metre is not None,
    )


def _layers(source: Source, views: tuple[View, ...], cameras: tuple[Camera, ...]) -> FrameSource:
    """What decodes a view, a layer for each kind of image that some view has."""
    frames: FrameSource = Photographs(views=views, cameras=cameras)
    if any(view.depth is not None for view in views):
        frames = WithDepth(below=frames, views=views, units_per_metre=source.depth_units_per_metre)
    if any(view.ids is not None for view in views):
        frames = WithIds(below=frames, views=views, codes=source.id_codes)
    if any(view.normals is not None for view in views):
        frames = WithNormals(below=frames, views=views)
    return frames


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
    missing = [view.name for view in source.views if not is_file(view.image)]
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
    for kind, what in (("depth", "depth images"), ("ids", "id images"), ("normals", "normal images")):
        named = [view for view in views if getattr(view, kind) is not None]
        missing = [view.name for view in named if not is_file(getattr(view, kind))]
        if missing and not config.allow_missing:
            remedy = f"Add them, or pass --capture.allow-missing or --capture.no-use-{kind}."
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


def _check_headers(source: Source, views: tuple[View, ...]) -> None:
    """Compare sizes in the files' headers with the intrinsics; pixels are not decoded."""
    wrong = []
    for view in views:
        width, height = image_size(view.image)
        if (width, height) != (view.lens.width, view.lens.height):
            wrong.append(f"{view.name} has {width} x {height}, expected {view.lens.width} x {view.lens.height}")
    if wrong:
        remedy = "Scale the images or the intrinsics; where sides are swapped, rotate the pixels as EXIF says."
        raise complain(source.path, wrong, len(views), "images are not of the size of their intrinsics", remedy)
    for view in views:
        for path in (view.depth, view.ids, view.normals):
            if path is not None and path.suffix.lower() != ".npy":
                check_shape(path, *image_size(path), view.lens)
