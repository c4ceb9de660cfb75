"""The training views on the device that renders them: decoded on the CPU; on a GPU uploaded once or ahead."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Bool, Int16, UInt8
from torch import Tensor

from goc.device import CPU
from goc.geometry.monocular import SCALE
from goc.raster import Engine, Views, views_of
from goc.reconstruct.losses import GeometryPrior, RenderedDepth
from goc.reconstruct.monocular import ALIGNMENT
from goc.reconstruct.task import Task

_SHARE = 0.5
"""Share of the device's memory, free at the start of a run, that views may take; splats and images need the rest."""
_NOTHING = RenderedDepth(numerator=torch.zeros(1, 1, 1), denominator=torch.zeros(1, 1, 1), alpha=torch.zeros(1, 1, 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainingView:
    """One training view with its tensors on the device that renders it."""

    index: int
    """Number of the view in the capture."""
    views: Views
    """The camera of this view, as one view."""
    image: UInt8[Tensor, "h w 3"]
    ids: Int16[Tensor, "h w"] | None
    valid: Bool[Tensor, "h w"] | None
    """Where the colour counts; None: everywhere."""
    prior: GeometryPrior | None
    """Depth and normals to compare with; None where the view has none, or where they are made later (`waits`)."""
    waits: bool
    """The prior is made after the view is rendered, because it may depend on the depth of the splats."""


class HostViews:
    """Views on the CPU: frames of the capture, whose cache keeps them. Priors are made when a view is rendered.

    `remembered` is `State.views` in every method.
    """

    def __init__(self, task: Task) -> None:
        """Take the views from the capture of `task`."""
        self._task = task
        self._posed: dict[int, Views] = {}

    def __enter__(self) -> "HostViews":
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def get(self, view: int, remembered: dict[str, Tensor]) -> TrainingView:
        """Decode a view, or take it from the capture's cache."""
        frame = self._task.capture[view]
        if view not in self._posed:
            self._posed[view] = views_of([frame.camera], CPU)
        images = {"image": frame.image, "ids": frame.ids, "valid": frame.valid}
        return TrainingView(index=view, views=self._posed[view], **images, prior=None, waits=True)

    def prefetch(self, wanted: Sequence[int], remembered: dict[str, Tensor]) -> None:
        """Do nothing: the capture decodes views when they are asked for."""

    def prior(
        self, item: TrainingView, remembered: dict[str, Tensor], shown: RenderedDepth, epoch: int
    ) -> GeometryPrior | None:
        """Make the prior of a view from its rendered depth `shown`; None where the view has no depth and no normals."""
        return self._task.prior(item.index, remembered, shown, epoch)


class UploadedViews:
    """Views on a device, used like `HostViews`. A worker thread decodes, makes priors and uploads while it computes."""

    def __init__(self, task: Task, device: torch.device) -> None:
        """Upload the views of the capture of `task` to `device`."""
        self._task, self._device = task, device
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="goc-upload")
        self._stream = torch.cuda.Stream(device) if device.type == "cuda" else None
        self._room = _SHARE * torch.cuda.mem_get_info(device)[0] if device.type == "cuda" else float("inf")
        self._kept: dict[int, TrainingView] = {}
        self._coming: dict[int, Future[TrainingView]] = {}

    def __enter__(self) -> "UploadedViews":
        return self

    def __exit__(self, *error: object) -> None:
        self._worker.shutdown(cancel_futures=True)

    def prefetch(self, wanted: Sequence[int], remembered: dict[str, Tensor]) -> None:
        """Start to upload views that a later step needs."""
        for view in wanted:
            if view not in self._kept and view not in self._coming:
                self._coming[view] = self._worker.submit(self._upload, view, remembered)

    def get(self, view: int, remembered: dict[str, Tensor]) -> TrainingView:
        """Return a view on the device. It is kept there if it fits and its prior does not change."""
        if view in self._kept:
            return self._kept[view]
        self.prefetch([view], remembered)
        found = self._coming.pop(view).result()
        tensors = _tensors(found)
        if self._stream is not None:
            torch.cuda.current_stream(self._device).wait_stream(self._stream)
            for tensor in tensors:
                tensor.record_stream(torch.cuda.current_stream(self._device))
        size = sum(tensor.numel() * tensor.element_size() for tensor in tensors)
        if size <= self._room and not found.waits:
            self._room -= size
            self._kept[view] = found
        return found

    def prior(
        self, item: TrainingView, remembered: dict[str, Tensor], shown: RenderedDepth, epoch: int
    ) -> GeometryPrior | None:
        """Return the uploaded prior, or fit one on the CPU to the rendered depth `shown`, waiting for the device."""
        if not item.waits:
            return item.prior
        seen = RenderedDepth(**{part.name: getattr(shown, part.name).detach().cpu() for part in fields(shown)})
        prior = self._worker.submit(self._task.prior, item.index, remembered, seen, epoch).result()
        if prior is None:
            return None
        normals = None if prior.normals is None else prior.normals.to(self._device)
        return GeometryPrior(depth=prior.depth.to(self._device), normals=normals)

    def _upload(self, view: int, remembered: dict[str, Tensor]) -> TrainingView:
        frame = self._task.capture[view]
        weights, prior, seen = self._task.config.losses, None, views_of([frame.camera], CPU)
        waits = self._waits(view, remembered)
        if (weights.depth or weights.depth_normal) and not waits:
            prior = self._task.prior(view, remembered, _NOTHING, 0)
        if prior is not None:
            normals = None if prior.normals is None else self._copied(prior.normals)
            prior = GeometryPrior(depth=self._copied(prior.depth), normals=normals)
        matrices = {name: self._copied(getattr(seen, name)) for name in ("cam_from_world", "intrinsics")}
        return TrainingView(
            index=view,
            views=replace(seen, **matrices),
            image=self._copied(frame.image),
            ids=self._copied(frame.ids) if self._task.names and frame.ids is not None else None,
            valid=None if frame.valid is None else self._copied(frame.valid),
            prior=prior,
            waits=waits,
        )

    def _waits(self, view: int, remembered: dict[str, Tensor]) -> bool:
        """Whether a view's monocular depth has to be fitted to the rendered depth of the splats."""
        if ALIGNMENT not in remembered:
            return False
        fitted = torch.isfinite(remembered[ALIGNMENT][view, SCALE]).item()
        return not fitted or self._task.config.losses.monocular.refresh_every > 0

    def _copied(self, tensor: Tensor) -> Tensor:
        """Copy a tensor to the device from pinned memory, on the upload stream."""
        if self._stream is None:
            return tensor
        with torch.cuda.stream(self._stream):
            return tensor.contiguous().pin_memory().to(self._device, non_blocking=True)


def _tensors(view: TrainingView) -> list[Tensor]:
    priors = (None, None) if view.prior is None else (view.prior.depth, view.prior.normals)
    images = (view.image, view.ids, view.valid, *priors, view.views.cam_from_world, view.views.intrinsics)
    return [image for image in images if image is not None]


TrainingViews = HostViews | UploadedViews


def training_views(task: Task, engine: Engine) -> TrainingViews:
    """Choose where the views of a task are kept for an engine: on the CPU, or uploaded to its device."""
    return HostViews(task) if engine.fused else UploadedViews(task, engine.device)
