"""`goc doctor`: what this machine can do, found out by trying, and one line of remedy for what it cannot."""

import importlib.util
import platform
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import tyro

from goc import __version__
from goc.cli.arguments import parse

if TYPE_CHECKING:
    from goc.runs import Machine

_MIN_MEMORY_GB, _MIN_DISK_GB = 4.0, 2.0


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Say what this machine can do, and how to mend what it cannot."""

    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """For bug reports: machine-readable, to stdout."""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing looked at."""

    name: str
    value: str
    ok: bool
    needed: bool
    """Without it, goc does not work here."""
    remedy: str = ""
    """What to do where it is not ok."""


def main(words: Sequence[str]) -> int:
    """Run `goc doctor`; 0 where goc works on this machine, else 4."""
    arguments = parse(Arguments, words, "goc doctor")
    findings = examine(Path.cwd())
    if arguments.json:
        encoded = msgspec.json.encode([asdict(found) for found in findings])
        sys.stdout.write(msgspec.json.format(encoded).decode() + "\n")
    else:
        sys.stdout.write("".join(_line(found) for found in findings))
    return 0 if all(found.ok for found in findings if found.needed) else 4


def examine(folder: Path) -> list[Finding]:
    """Look at everything that decides whether and how fast goc works; `folder` stands for where results go."""
    again = "install again: pip install --force-reinstall . -c constraints.txt"
    less = f"below {_MIN_MEMORY_GB:.0f} GB use --reconstruct.mcmc.max-splats 40000 --capture.max-side-px 640."
    return [
        Finding(name="goc", value=__version__, ok=True, needed=False),
        Finding(
            name="system", value=f"{platform.system()} {platform.release()} {platform.machine()}", ok=True, needed=False
        ),
        Finding(name="python", value=platform.python_version(), ok=True, needed=False),
        *(_tried(name, partial(version, name), True, again) for name in ("torch", "numpy", "scipy", "pillow")),
        _tried("kernels", _try_kernels, True, again),
        _tried("processor", _try_processor, True, again),
        _tried("vectors", _try_vectors, False, "goc works, slower: there are no kernels for faster instructions here."),
        _tried("memory", _try_memory, False, less),
        _tried("disk", partial(_try_disk, folder), False, "free some space, or point --out elsewhere."),
        _tried("cuda", _try_cuda, False, "not needed: goc computes on the processor where there is no such device."),
        _tried(
            "gsplat",
            _try_gsplat,
            False,
            "a CUDA device alone needs it: pip install goc[cuda], docs/guide/gpu.md.",
        ),
    ]


def _tried(name: str, trial: Callable[[], str], needed: bool, remedy: str) -> Finding:
    try:
        return Finding(name=name, value=trial(), ok=True, needed=needed)
    except Exception as error:  # whatever a broken installation raises is the finding
        lines = str(error).splitlines() or [type(error).__name__]
        return Finding(name=name, value=lines[0][:160], ok=False, needed=needed, remedy=remedy)


# Each trial imports what it tries: a broken installation should be a finding, not the end of the examination.


def _machine() -> "Machine":
    from goc.runs import this_machine

    return this_machine()


def _try_processor() -> str:
    machine = _machine()
    return f"{machine.cpu}, {machine.cores} cores, {machine.threads} threads used"


def _try_vectors() -> str:
    level = _machine().simd
    if level == "portable":
        raise RuntimeError("portable")
    return level


def _try_memory() -> str:
    found = _machine().memory_gb
    if found < _MIN_MEMORY_GB:
        raise RuntimeError(f"{found:.1f} GB")
    return f"{found:.1f} GB"


def _try_disk(folder: Path) -> str:
    free_gb = shutil.disk_usage(folder).free / 1e9
    if free_gb < _MIN_DISK_GB:
        raise RuntimeError(f"{free_gb:.1f} GB free in {folder}")
    return f"{free_gb:.1f} GB free in {folder}"


def _try_kernels() -> str:
    """Draw one opaque splat in the middle of a small picture, and its gradient."""
    import torch

    from goc.raster import rasterize
    from goc.scene import Camera, Gaussians

    camera = Camera(
        focal_px=torch.tensor([16.0, 16.0]),
        centre_px=torch.tensor([8.0, 8.0]),
        width=16,
        height=16,
        world_from_cam=torch.eye(4),
    )
    splat = Gaussians(
        means=torch.tensor([[0.0, 0.0, 2.0]], requires_grad=True),
        quats=torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        log_scales=torch.full((1, 3), -1.5),
        opacity_logits=torch.full((1,), 6.0),
        sh=torch.zeros(1, 1, 3),
    )
    image, _ = rasterize(splat, camera, torch.ones(1, 1))
    image.sum().backward()
    if not (0.9 < image.max().item() <= 1.0 and torch.isfinite(splat.means.grad).all()):
        raise RuntimeError(f"a splat was drawn wrongly (brightest pixel {image.max().item():.3f} instead of about 1)")
    return "work: a splat was drawn, and its gradient taken"


def _try_cuda() -> str:
    import torch

    if not torch.cuda.is_available():
        raise RuntimeError("no CUDA device that torch can use")
    ones = torch.ones(64, 64, device="cuda")
    if (ones @ ones)[0, 0].item() != 64.0:
        raise RuntimeError("a matrix product on the CUDA device came out wrong")
    return f"works: {torch.cuda.get_device_name()} multiplied two matrices"


def _try_gsplat() -> str:
    """A trial view and its gradients, as `goc carve` has them before it takes the device."""
    if importlib.util.find_spec("gsplat") is None:
        raise RuntimeError("not installed")
    from goc.raster import cuda_flaw

    flaw = cuda_flaw()
    if flaw is not None:
        raise RuntimeError(f"{version('gsplat')} installed, not used: {flaw}")
    return f"works: {version('gsplat')} draws on the CUDA device as the processor does"


def _line(found: Finding) -> str:
    mark = "ok  " if found.ok else "FAIL" if found.needed else "--  "
    remedy = "" if found.ok else f"\n{'':17}{found.remedy}"
    return f"{mark} {found.name:<10}  {found.value}{remedy}\n"
