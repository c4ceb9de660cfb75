"""The losses of paper §4.2–4.4: means over valid pixels and over the views of a batch, each a scalar."""

from goc.reconstruct.losses.depth import RenderedDepth, inverse_depth, rendered_depth
from goc.reconstruct.losses.geometry import GeometryPrior, geometry_loss, stacked_priors
from goc.reconstruct.losses.identity import identity_loss
from goc.reconstruct.losses.multiview import Neighbour, PairWeights, multiview_loss
from goc.reconstruct.losses.photometric import photometric_loss

__all__ = [
    "GeometryPrior",
    "Neighbour",
    "PairWeights",
    "RenderedDepth",
    "geometry_loss",
    "identity_loss",
    "inverse_depth",
    "multiview_loss",
    "photometric_loss",
    "rendered_depth",
    "stacked_priors",
]
