"""Which object a splat belongs to: by votes (default), or learned (paper §4.3)."""

import torch
from jaxtyping import Float, Int16
from torch import Tensor

from goc.events import Listener, Progress, ignore
from goc.raster import rasterize
from goc.scene.camera import Camera
from goc.scene.capture import UNLABELLED, Capture
from goc.scene.gaussians import Gaussians

FEATURES = 16
"""Width of the instance features f of Eq. (7); the paper does not state it, Gaussian Grouping (2024) has 16. gsplat
would pad them with colour and depth to 32 channels: there they fill what colour and depth leave of 16."""
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


def feature_width(fused: bool, planes: bool) -> int:
    """Instance features that an engine blends beside colour (3) and planes (4) or depth (1)."""
    return FEATURES if fused else FEATURES - (7 if planes else 4)


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


@torch.no_grad()
def learned_labels(
    gaussians: Gaussians, classifier: dict[str, Tensor], names: list[int], seen: Tensor
) -> Int16[Tensor, "n"]:
    """Give each splat the class of its own feature; UNLABELLED where `seen` is false."""
    assert gaussians.identity is not None
    return _winners(classify(gaussians.identity, classifier), names, seen)


def _winners(scores: Float[Tensor, "n k"], names: list[int], known: Tensor) -> Int16[Tensor, "n"]:
    if not names:
        return torch.full((len(scores),), UNLABELLED, dtype=torch.int16)
    labels = torch.tensor(names, dtype=torch.int16)[scores.argmax(-1)]
    return torch.where(known, labels, UNLABELLED)
