"""The frozen judge: what a run made against complete ground truth, by protocols of fixed numbers."""

from goc.evaluation.evaluate import evaluate
from goc.evaluation.result import (
    Counts,
    Evaluation,
    ExtraObject,
    Figures,
    Matching,
    MeshChoice,
    ObjectEvaluation,
    Protocol,
)

__all__ = [
    "Counts",
    "Evaluation",
    "ExtraObject",
    "Figures",
    "Matching",
    "MeshChoice",
    "ObjectEvaluation",
    "Protocol",
    "evaluate",
]
