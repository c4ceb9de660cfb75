"""Learned labels: what blends are classified as decides, not what single splats would be."""

import torch

from cameras import capture_of, grey, pinhole
from goc.reconstruct.labels import classified_views, classify, feature_width, vote_labels
from goc.scene import Capture, Frame, Gaussians
from goc.scene.capture import UNLABELLED

SIDE = 32
CLASSIFIER = {
    "hidden_weight": torch.eye(2),
    "hidden_bias": torch.zeros(2),
    "class_weight": torch.eye(2),
    "class_bias": torch.zeros(2),
}
"""The larger of two features decides."""


def wall_with_a_stranger() -> tuple[Gaussians, Capture]:
    """A wall of splats of the first class, and before its middle a faint one that by itself is of the second."""
    across = torch.linspace(-0.5, 0.5, 11)
    places = torch.stack([*torch.meshgrid(across, across, indexing="xy"), torch.full((11, 11), 2.0)], -1).reshape(-1, 3)
    count = len(places) + 1
    splats = Gaussians(
        means=torch.cat([places, torch.tensor([[0.0, 0.0, 1.9]])]),
        quats=torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(count, 4).contiguous(),
        log_scales=torch.full((count, 3), 0.06).log(),
        opacity_logits=torch.cat([torch.full((count - 1,), 3.0), torch.tensor([-2.0])]),
        sh=torch.zeros(count, 1, 3),
        identity=torch.cat([torch.tensor([[1.0, 0.0]]).expand(count - 1, 2), torch.tensor([[0.0, 0.5]])]),
    )
    camera = pinhole(40.0, (SIDE, SIDE))
    frame = Frame(camera=camera, image=grey(camera, 0))
    capture = capture_of([frame])
    return splats, capture


def test_a_faint_splat_takes_the_label_of_what_it_is_blended_with():
    splats, capture = wall_with_a_stranger()
    assert classify(splats.identity, CLASSIFIER).argmax(-1).tolist() == [0] * 121 + [1]
    views = classified_views(splats, CLASSIFIER, [3, 8], capture)
    assert views[0].ids[SIDE // 2, SIDE // 2] == 3 and views[0].ids[0, 0] == UNLABELLED
    assert views.has_ids and views[0].ids.dtype == torch.int16
    assert vote_labels(splats, views, [0]).tolist() == [3] * 122


def test_features_fill_sixteen_channels():
    assert 3 + 4 + feature_width(planes=True) == 16 == 3 + 1 + feature_width(planes=False)
