"""Scores a run against complete ground truth, by protocols whose numbers are fixed."""

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
from goc.evaluation.write import write_evaluation

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
    "write_evaluation",
]
