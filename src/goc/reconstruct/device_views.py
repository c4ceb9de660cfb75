"""The training views where they are drawn: uploaded once if they fit there, else brought in while a step runs."""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import torch
from jaxtyping import Float, Float16, Int16, UInt8
from torch import Tensor

from goc.raster import CPU, Views, views_of
from goc.reconstruct.losses import GeometryPrior, RenderedDepth
from goc.reconstruct.monocular import ALIGNMENT, SCALE
from goc.reconstruct.task import Task
from goc.scene.capture import UNLABELLED

_SHARE = 0.5
"""Of the device's free memory that views may take at the start of a run; splats and images need the rest."""
_BYTES_A_PIXEL = 3 + 4 + 6 + 2
_NOTHING = RenderedDepth(numerator=torch.zeros(1, 1), denominator=torch.zeros(1, 1), alpha=torch.zeros(1, 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class DeviceView:
    """One view on the device."""

    views: Views
    """This one alone."""
    image: UInt8[Tensor, "h w 3"]
    depth: Float[Tensor, "h w"] | None
    """Of the prior; NaN = none. None where a view has no prior, or none that could be made before it is drawn."""
    normals: Float16[Tensor, "h w 3"] | None
    """Of the prior: unit, NaN = none; in half precision, 0.05 %."""
    classes: Int16[Tensor, "h w"] | None
    """Places of the ids among `Task.names`, UNLABELLED = other; None where nothing is learned."""


class DeviceViews:
    """Gives views on demand; one worker thread decodes, makes priors and copies while the device computes."""

    def __init__(self, task: Task, device: torch.device) -> None:
        """Of a task's capture, on a device."""
        self._task, self._device = task, device
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="goc-upload")
        self._stream = torch.cuda.Stream(device) if device.type == "cuda" else None
        self._room = _SHARE * torch.cuda.mem_get_info(device)[0] if device.type == "cuda" else float("inf")
        self._kept: dict[int, DeviceView] = {}
        self._coming: dict[int, Future[DeviceView]] = {}

    def __enter__(self) -> "DeviceViews":
        return self

    def __exit__(self, *error: object) -> None:
        self._worker.shutdown(cancel_futures=True)

    def prefetch(self, wanted: Sequence[int], remembered: dict[str, Tensor]) -> None:
        """Begin to bring views that a later step asks for; `remembered` is `State.views`."""
        for view in wanted:
            if view not in self._kept and view not in self._coming:
                self._coming[view] = self._worker.submit(self._upload, view, remembered)

    def get(self, view: int, remembered: dict[str, Tensor]) -> DeviceView:
        """A view, kept while there is room for it."""
        if view in self._kept:
            return self._kept[view]
        self.prefetch([view], remembered)
        found = self._coming.pop(view).result()
        if self._stream is not None:
            torch.cuda.current_stream(self._device).wait_stream(self._stream)
            for tensor in _tensors(found):
                tensor.record_stream(torch.cuda.current_stream(self._device))
        size = _BYTES_A_PIXEL * found.image.shape[0] * found.image.shape[1]
        if size <= self._room and not self.waits(view, remembered):
            self._room -= size
            self._kept[view] = found
        return found

    def waits(self, view: int, remembered: dict[str, Tensor]) -> bool:
        """Whether a view's prior depends on what the splats show of it: monocular depth that is to be fitted."""
        if ALIGNMENT not in remembered:
            return False
        fitted = torch.isfinite(remembered[ALIGNMENT][view, SCALE]).item()
        return not fitted or self._task.config.monocular.refresh_every > 0

    def fitted_prior(
        self, view: int, remembered: dict[str, Tensor], shown: RenderedDepth, epoch: int
    ) -> tuple[Tensor, Tensor | None] | None:
        """Depth and normals of a view that waits, fitted on the processor to what it shows; waits for the device."""
        seen = RenderedDepth(**{item.name: getattr(shown, item.name).detach().cpu() for item in fields(shown)})
        prior = self._worker.submit(self._task.prior, view, remembered, seen, epoch).result()
        if prior is None:
            return None
        normals = _unit_normals(prior)
        return prior.depth.to(self._device), None if normals is None else normals.to(self._device)

    def _upload(self, view: int, remembered: dict[str, Tensor]) -> DeviceView:
        task = self._task
        frame = task.capture[view]
        weights, prior, classes = task.config.losses, None, None
        if (weights.depth or weights.depth_normal) and not self.waits(view, remembered):
            prior = task.prior(view, remembered, _NOTHING, 0)
        if task.names and frame.ids is not None:
            classes = torch.full_like(frame.ids, UNLABELLED)
            for place, name in enumerate(task.names):
                classes[frame.ids == name] = place
        seen = views_of([frame.camera], CPU)
        return DeviceView(
            views=replace(
                seen, cam_from_world=self._copied(seen.cam_from_world), intrinsics=self._copied(seen.intrinsics)
            ),
            image=self._copied(frame.image),
            depth=None if prior is None else self._copied(prior.depth),
            normals=self._copied(_unit_normals(prior)),
            classes=self._copied(classes),
        )

    def _copied(self, tensor: Tensor | None) -> Tensor | None:
        """On the device, from pinned memory on a stream of its own."""
        if tensor is None or self._stream is None:
            return tensor
        with torch.cuda.stream(self._stream):
            return tensor.contiguous().pin_memory().to(self._device, non_blocking=True)


def _unit_normals(prior: GeometryPrior | None) -> Float16[Tensor, "h w 3"] | None:
    """Normals of a prior in one form: bytes are of any length there, 0 0 0 = none."""
    if prior is None or prior.normals is None:
        return None
    if prior.normals.dtype != torch.int8:
        return prior.normals.half()
    normals = prior.normals.float()
    length = normals.norm(dim=-1, keepdim=True)
    return torch.where(length > 0, normals / length, torch.nan).half()


def _tensors(view: DeviceView) -> list[Tensor]:
    images = (view.image, view.depth, view.normals, view.classes, view.views.cam_from_world, view.views.intrinsics)
    return [image for image in images if image is not None]
