"""Which device computes: the processor, or a CUDA device that has shown that it can."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

import torch

from goc.errors import EngineError
from goc.events import Listener, Warned, ignore

DeviceName = Literal["auto", "cpu", "cuda"]
CPU, FIRST = torch.device("cpu"), torch.device("cuda", 0)
"""CUDA_VISIBLE_DEVICES says which one is the first."""
REMEDY = (
    "It takes a PyTorch for CUDA, gsplat (pip install goc[cuda]) and CUDA's nvcc to compile it: see docs/guide/gpu.md. "
    "--device cpu needs none of them."
)


def choose_device(
    wanted: DeviceName, flaw_of: Callable[[torch.device], str | None], notify: Listener = ignore
) -> torch.device:
    """The device of a run, found out by trying.

    Args:
        wanted: auto takes a CUDA device where there is one that passes the trial.
        flaw_of: the trial: why a device cannot be used, in one line; None where it can.
        notify: hears Warned of a device that is there, was tried and is not used.

    Raises:
        EngineError: cuda is wanted and does not work.
    """
    there = torch.cuda.is_available()
    if wanted == "cpu" or (wanted == "auto" and not there):
        return CPU
    flaw = flaw_of(FIRST) if there else "PyTorch sees no CUDA device"
    if flaw is None:
        return FIRST
    if wanted == "cuda":
        raise EngineError(f"--device cuda cannot run here: {flaw}. {REMEDY}")
    notify(Warned(stage="device", message=f"CUDA device not used, the processor computes: {flaw}. {REMEDY}"))
    return CPU


def working_device(wanted: DeviceName = "auto") -> torch.device:
    """For what needs PyTorch alone: a CUDA device that multiplies two matrices, unless cpu is wanted; else the CPU."""
    try:
        device = FIRST if wanted != "cpu" and torch.cuda.is_available() else CPU
        ones = torch.ones(8, 8, device=device)
        return device if (ones @ ones)[0, 0].item() == 8.0 else CPU
    except (RuntimeError, AssertionError):  # a driver or a device that this PyTorch was not built for
        return CPU


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Leave the cores to the native kernels: PyTorch's own threads spin between its many small operations."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
