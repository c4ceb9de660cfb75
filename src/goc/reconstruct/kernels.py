"""Device dispatch: native kernels take single precision on the processor, their PyTorch twins everything else."""

import torch
from jaxtyping import Float
from torch import Tensor


def natively(tensor: Tensor) -> bool:
    """Whether native kernels compute with a tensor; the twin in PyTorch does where they cannot.

    Each loss, Adam and the penalties exist twice: a native kernel that writes its gradient along, and plain PyTorch for
    any device and precision, gradients by autograd, which never waits for the device. The tests hold both together.
    """
    return tensor.device.type == "cpu" and tensor.dtype == torch.float32


def scaled(gradient: Float[Tensor, "*s"], upstream: Float[Tensor, ""]) -> Float[Tensor, "*s"]:
    """A kernel's gradient times what comes from above: usually 1, a term of the total; then no image is copied."""
    return gradient if upstream.item() == 1.0 else gradient * upstream
