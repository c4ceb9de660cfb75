"""Device dispatch: native kernels take single precision on the processor, their PyTorch twins everything else."""

import torch
from jaxtyping import Float
from torch import Tensor

from goc import _native
from goc.scene.camera import Camera


def natively(tensor: Tensor) -> bool:
    """Whether native kernels compute with a tensor; the twin in PyTorch does where they cannot.

    Each loss, Adam and the penalties exist twice: a native kernel that writes its gradient along, and plain PyTorch for
    any device and precision, gradients by autograd, which never waits for the device. The tests hold both together.
    """
    return tensor.device.type == "cpu" and tensor.dtype == torch.float32


def scaled(gradient: Float[Tensor, "*s"], upstream: Float[Tensor, ""]) -> Float[Tensor, "*s"]:
    """A kernel's gradient times what comes from above: usually 1, a term of the total; then no image is copied."""
    return gradient if upstream.item() == 1.0 else gradient * upstream


def lens_of(camera: Camera, size: tuple[int, int] | None = None, stride: int = 1) -> _native.Lens:
    """Intrinsics as the kernels take them, of every `stride`-th pixel of a view.

    Args:
        camera: the view.
        size: height and width of the image, where that is not the camera's.
        stride: odd; the middle one of each block of so many pixels is kept.
    """
    height, width = size or (camera.height, camera.width)
    numbers = [value / stride for value in (*camera.focal_px.tolist(), *camera.centre_px.tolist())]
    return _native.Lens(*numbers, width, height)
