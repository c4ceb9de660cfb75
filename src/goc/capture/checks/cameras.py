"""Checks of intrinsics and poses by themselves: no image is opened."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import torch

from goc.capture.checks.finding import Finding, contradiction, doubt
from goc.capture.checks.sample import all_poses
from goc.capture.source import Source, count_of, shown
from goc.scene import Capture

_CORNER_PX = 1.5
_OFF_CENTRE = 0.25
"""Distance of the principal point from the middle, as a share of the image's side, that few cameras have."""
_WIDEST_DEG, _NARROWEST_DEG = 150.0, 4.0
_WIDE_DEG, _NARROW_DEG = 125.0, 14.0
_SQUARE = 1.2
_FEW_DOUBLED = 0.1
_STRAY = 30.0
"""Distance from the middle of the cameras, in median distances, of one that got lost."""


def camera_findings(source: Source, capture: Capture) -> Iterator[Finding]:
    """What intrinsics and poses tell on their own."""
    yield from _principal_point(source)
    yield from _angle_of_view(capture)
    yield from _pixel_shape(source)
    yield from _positions(capture)
    yield from _seed_points(capture)


def _principal_point(source: Source) -> Iterator[Finding]:
    corner, far = [], []
    for view in source.views:
        lens = view.lens
        x, y = lens.centre_px
        if max(abs(x), abs(y)) <= _CORNER_PX and min(lens.width, lens.height) > 8 * _CORNER_PX:
            corner.append(f"{view.name}: cx {x:g}, cy {y:g}")
        elif abs(x / lens.width - 0.5) > _OFF_CENTRE or abs(y / lens.height - 0.5) > _OFF_CENTRE:
            far.append(f"{view.name}: {x:.0f}, {y:.0f} of {lens.width} x {lens.height}")
    if corner:
        yield contradiction(
            "principal-point",
            f"the principal point is the image's corner in {count_of(corner, len(source.views))} views (first: "
            f"{shown(corner[0])}). Give cx and cy in pixels, near the middle, or leave them out.",
        )
    if far:
        yield doubt(
            "principal-point",
            f"the principal point is far from the middle in {count_of(far, len(source.views))} views (first: "
            f"{shown(far[0])}): if the images were not cropped, cx and cy are of another size of image",
        )


def _angle_of_view(capture: Capture) -> Iterator[Finding]:
    views = []
    for name, camera in zip(capture.view_names, capture.cameras, strict=True):
        side = max(camera.width, camera.height)
        focal = float(camera.focal_px[0 if camera.width >= camera.height else 1])
        views.append((math.degrees(2 * math.atan(side / 2 / focal)), name, focal, side))
    for severity, low, high in ((contradiction, _NARROWEST_DEG, _WIDEST_DEG), (doubt, _NARROW_DEG, _WIDE_DEG)):
        bad = [view for view in views if not low < view[0] < high]
        if bad:
            angle, name, focal, side = bad[0]
            yield severity(
                "angle-of-view",
                f"{count_of(bad, len(views))} views see {angle:.3g} degrees across (first: {shown(name)}, focal length "
                f"{focal:.4g} of {side} pixels). Give fx, fy in pixels of the stored image, not in millimetres or of "
                "another size.",
            )
            return


def _pixel_shape(source: Source) -> Iterator[Finding]:
    bad = []
    for view in source.views:
        across, down = view.lens.focal_px
        if not 1 / _SQUARE < across / down < _SQUARE:
            bad.append(f"{view.name}: fx {across:.4g}, fy {down:.4g}")
    if bad:
        yield doubt(
            "pixel-shape",
            f"pixels are not square in {count_of(bad, len(source.views))} views (first: {shown(bad[0])}): if the "
            "images were not stretched, the intrinsics are of another size, or of the image on its side",
        )


def _positions(capture: Capture) -> Iterator[Finding]:
    poses, names = all_poses(capture), capture.view_names
    if len(poses) < 2:
        yield doubt("one-view", "there is one view only: what it does not see cannot be carved")
        return
    positions = poses[:, :3, 3]
    if np.abs(poses - poses[0]).max() < 1e-9:
        yield contradiction(
            "poses-equal", f"all {len(poses)} views have the same pose. Write the pose of each view, world from camera."
        )
        return
    size = float(np.abs(positions).max())
    if np.linalg.norm(positions - positions[0], axis=1).max() <= 1e-6 * max(size, 1e-6):
        yield doubt("one-spot", "all cameras stand on one spot: without parallax only given depth tells shapes")
        return
    _, first, times = np.unique(poses.round(9).reshape(len(poses), -1), axis=0, return_index=True, return_counts=True)
    doubled = int((times - 1).sum())
    if doubled > _FEW_DOUBLED * len(poses) or doubled > 3:
        yield doubt(
            "poses-repeat",
            f"{count_of(range(doubled), len(poses))} views repeat the pose of another (first: "
            f"{shown(names[int(first[times > 1][0])])}): tracking may have been lost there",
        )
    yield from _strays(positions, names)


def _strays(positions: np.ndarray, names: Sequence[str]) -> Iterator[Finding]:
    away = np.linalg.norm(positions - np.median(positions, axis=0), axis=1)
    typical = float(np.median(away))
    lost = np.flatnonzero(away > _STRAY * typical).tolist() if typical > 0 else []
    if lost:
        yield doubt(
            "poses-stray",
            f"{count_of(lost, len(positions))} cameras stand {away[lost].max() / typical:.0f} times as far out as the "
            f"others (first: {shown(names[lost[0]])}): poses that got lost. Remove these views.",
        )


def _seed_points(capture: Capture) -> Iterator[Finding]:
    points = capture.points
    if points is None or not len(points.positions):
        return
    if not np.isfinite(points.positions).all():
        return  # refused where they are read
    rows = np.linspace(0, len(points.positions) - 1, min(500, len(points.positions))).astype(int)

    chosen = torch.from_numpy(points.positions[rows].astype(np.float64))
    step = max(1, len(capture) // 40)
    seen = torch.stack([camera.double().sees(chosen) for camera in capture.cameras[::step]]).any(0).double().mean()
    if float(seen) < 0.2:
        yield doubt(
            "points-unseen",
            f"{100 * float(seen):.0f} % of the seed points lie in any view: points and poses look to be of different "
            "worlds (axes or scale), or the poses look world-to-camera (--capture.convention.poses world-to-camera)",
        )
