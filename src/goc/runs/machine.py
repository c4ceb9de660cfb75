"""The machine that this runs on, as reports and `goc doctor` tell it."""

import os
import platform
import resource
import sys
from pathlib import Path

import msgspec
import torch

from goc import _native


class Machine(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What decides how fast a run is, and which software it was."""

    system: str
    cpu: str
    cores: int
    """Cores that this process may use."""
    threads: int
    """Threads of goc's kernels."""
    simd: str
    """Instruction set that the kernels picked."""
    memory_gb: float
    """Of the machine, or of the container where that is less; GB = 10⁹ bytes."""
    python: str
    torch: str


def this_machine() -> Machine:
    """Describe the machine now."""
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
    """Most memory that this process ever held, MB = 10⁶ bytes."""
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
    """Content of a file that the system may not have."""
    try:
        return path.read_text()
    except OSError:
        return ""
