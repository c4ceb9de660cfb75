"""Capture → Capture whose ids agree between views: masks that see the same surface are one object."""

from goc.priors.consensus.repair import Repair
from goc.priors.consensus.stage import IdsMode, repair_ids

__all__ = ["IdsMode", "Repair", "repair_ids"]
