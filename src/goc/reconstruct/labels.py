"""Which object a splat belongs to: by votes (default), or learned (paper §4.3)."""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.events import Listener, Progress, ignore
from goc.raster import rasterize
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED, Capture, Frame, FrameSource
from goc.scene.gaussians import Gaussians

_CHANNELS = 16
"""What a step with features blends: colour, planes or depth, and as many features as there is room for. The paper does
not state their number. Kernels are compiled for certain numbers of channels, and pad others (gsplat to 32)."""
_MIN_ALPHA = 0.5
"""A pixel that is more background than splat shows no object."""
_HIDDEN = 64


def capture_ids(capture: Capture, views: list[int]) -> list[int]:
    """Every id that occurs in the views, ascending; UNLABELLED left out."""
    found: set[int] = set()
    for view in views:
        ids = capture[view].ids
        if ids is not None:
            found |= set(torch.unique(ids).tolist())
    return sorted(found - {UNLABELLED})


def votes_of_view(
    gaussians: Gaussians, camera: Camera, ids: Int16[Tensor, "h w"], names: list[int]
) -> Float[Tensor, "n k"]:
    """Σ_p w(g, p)·[ids(p) = names_k]: what each splat contributes to the pixels of each id.

    The gradient that reaches the channels of a c-channel image whose upstream gradient is the one-hot masks: the
    weights w = α T need no kernel of their own. After FlashSplat (Shen et al. 2024).
    """
    channels = torch.zeros(len(gaussians), len(names), device=gaussians.means.device, requires_grad=True)
    image, _ = rasterize(gaussians, camera, channels)
    masks = torch.stack([(ids == name).float() for name in names])
    image.backward(masks.permute(1, 2, 0).to(image.device))
    assert channels.grad is not None
    return channels.grad


def vote_labels(
    gaussians: Gaussians, capture: Capture, views: list[int], notify: Listener = ignore
) -> Int16[Tensor, "n"]:
    """Give each splat the id that most of its weight falls on, summed over the views; UNLABELLED if never seen.

    Each view is asked for the ids that it shows and no others: rooms have many, a view few. Votes are counted where the
    splats are; the labels are on the processor.
    """
    fixed = gaussians.detached()
    totals: dict[int, Float[Tensor, "n"]] = {}
    for done, view in enumerate(views, 1):
        frame = capture[view]
        names = [] if frame.ids is None else sorted(set(torch.unique(frame.ids).tolist()) - {UNLABELLED})
        if frame.ids is not None and names:
            votes = votes_of_view(fixed, frame.camera, frame.ids, names)
            for name, column in zip(names, votes.unbind(-1), strict=True):
                totals[name] = totals[name] + column if name in totals else column.clone()
        notify(Progress(stage="label", done=done, total=len(views)))
    names = sorted(totals)
    total = torch.stack([totals[name] for name in names], -1).cpu() if names else torch.zeros(len(fixed), 0)
    return _winners(total, names, total.sum(-1) > 0)


def feature_width(planes: bool) -> int:
    """Width of the instance features f of Eq. (7), blended beside colour (3) and planes (4) or depth (1)."""
    return _CHANNELS - (7 if planes else 4)


def new_classifier(classes: int, features: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Weights of the MLP that turns a rendered feature into class scores: features → 64 → classes."""

    def uniform(rows: int, columns: int) -> Tensor:
        return (torch.rand(rows, columns, generator=generator) * 2 - 1) / columns**0.5

    return {
        "hidden_weight": uniform(_HIDDEN, features),
        "hidden_bias": torch.zeros(_HIDDEN),
        "class_weight": uniform(classes, _HIDDEN),
        "class_bias": torch.zeros(classes),
    }


def classify(features: Float[Tensor, "p f"], classifier: dict[str, Tensor]) -> Float[Tensor, "p k"]:
    """Class scores (before the softmax) of features."""
    hidden = torch.relu(features @ classifier["hidden_weight"].T + classifier["hidden_bias"])
    return hidden @ classifier["class_weight"].T + classifier["class_bias"]


def classified_views(
    gaussians: Gaussians, classifier: dict[str, Tensor], names: list[int], capture: Capture
) -> Capture:
    """The capture with the ids that its views' blended features are classified as: what L_o has trained.

    A splat's own feature says less: only blends of several were ever compared with a mask (docs/decisions/0032).
    """
    weights = {name: weight.detach().cpu() for name, weight in classifier.items()}
    frames = ClassifiedFrames(
        below=capture.frames, gaussians=gaussians.detached(), classifier=weights, names=tuple(names)
    )
    return replace(capture, frames=frames, has_ids=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClassifiedFrames:
    """The views of another source, with the ids that their blended features are classified as."""

    below: FrameSource
    gaussians: Gaussians
    classifier: dict[str, Tensor]
    names: tuple[int, ...]
    """Ids, in the order of the classes."""

    @torch.no_grad()
    def __call__(self, index: int) -> Frame:
        """One view, on the processor; drawn where the splats are."""
        frame = self.below(index)
        assert self.gaussians.identity is not None
        device = self.gaussians.means.device
        features, alpha = rasterize(self.gaussians, frame.camera.to(device), self.gaussians.identity)
        weights = {name: weight.to(device) for name, weight in self.classifier.items()}
        classes = classify(features.flatten(0, 1), weights).argmax(-1)
        found = torch.tensor(self.names, dtype=torch.int16, device=device)[classes].view(alpha.shape)
        return replace(frame, ids=torch.where(alpha >= _MIN_ALPHA, found, UNLABELLED).cpu())


def _winners(scores: Float[Tensor, "n k"], names: list[int], known: Tensor) -> Int16[Tensor, "n"]:
    if not names:
        return torch.full((len(scores),), UNLABELLED, dtype=torch.int16)
    labels = torch.tensor(names, dtype=torch.int16)[scores.argmax(-1)]
    return torch.where(known, labels, UNLABELLED)
