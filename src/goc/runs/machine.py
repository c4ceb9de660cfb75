"""Description of this machine for reports and `goc doctor`."""

import os
import platform
import resource
import sys
from pathlib import Path

import msgspec
import torch

from goc import _native


class Machine(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Hardware and software that a run used."""

    system: str
    cpu: str
    cores: int
    """Cores that this process may use."""
    threads: int
    """Threads of goc's kernels."""
    simd: str
    """Instruction set that the kernels picked."""
    memory_gb: float
    """Memory of the machine, or of its container if that is less; GB = 10⁹ bytes."""
    python: str
    torch: str


def this_machine() -> Machine:
    """Describe this machine."""
    return Machine(
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        cpu=_cpu_name(),
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        threads=_native.thread_count(),
        simd=_native.simd_level(),
        memory_gb=round(_memory_bytes() / 1e9, 1),
        python=platform.python_version(),
        torch=str(torch.__version__),
    )


def peak_memory_mb() -> float:
    """Peak memory of this process, MB = 10⁶ bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak * (1 if sys.platform == "darwin" else 1024) / 1e6


def _cpu_name() -> str:
    text = _text(Path("/proc/cpuinfo"))
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _memory_bytes() -> int:
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    limit = _text(Path("/sys/fs/cgroup/memory.max")).strip()
    return min(whole, int(limit)) if limit.isdigit() else whole


def _text(path: Path) -> str:
    """Content of a file; empty if it cannot be read, since not every system has it."""
    try:
        return path.read_text()
    except OSError:
        return ""
