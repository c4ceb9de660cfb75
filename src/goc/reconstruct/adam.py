"""Adam's step, in place: in one native pass over a parameter, or in PyTorch where the parameter lives."""

import math

import torch
from torch import Tensor

from goc import _native
from goc.reconstruct import kernels
from goc.reconstruct.state import State

_BETA1, _BETA2, _EPSILON = 0.9, 0.999, 1e-15
Rates = dict[str, tuple[float, ...]]
"""Step size of each column of a parameter's rows, by its name; the last one stands for all further columns."""


@torch.no_grad()
def adam(state: State, rates: Rates) -> None:
    """One step of Adam (Kingma & Ba 2015) on every parameter that has a gradient; clears the gradients.

    Args:
        state: parameters, gradients and moments, all changed in place; its step says how to unbias.
        rates: of each parameter.
    """
    for name, parameter in state.parameters.items():
        if parameter.grad is None or parameter.numel() == 0:
            continue
        rows = parameter.detach().view(len(parameter), -1)
        columns = list(rates[name]) + [rates[name][-1]] * (rows.shape[1] - len(rates[name]))
        moments = state.first[name].view(rows.shape), state.second[name].view(rows.shape)
        gradient = parameter.grad.contiguous().view(rows.shape)
        move = _move_natively if kernels.natively(rows) else _move
        move(rows, gradient, moments, columns[: rows.shape[1]], state.step + 1)
        parameter.grad = None


def _move_natively(
    rows: Tensor, gradient: Tensor, moments: tuple[Tensor, Tensor], rates: list[float], step: int
) -> None:
    _native.adam(rows, gradient, *moments, rates, _BETA1, _BETA2, _EPSILON, step)


def _move(rows: Tensor, gradient: Tensor, moments: tuple[Tensor, Tensor], rates: list[float], step: int) -> None:
    first, second = moments
    unbias = math.sqrt(1.0 - _BETA2**step)
    scale = unbias / (1.0 - _BETA1**step)
    first.lerp_(gradient, 1.0 - _BETA1)
    second.mul_(_BETA2).addcmul_(gradient, gradient, value=1.0 - _BETA2)
    moves = first / (second.sqrt() + _EPSILON * unbias)
    for columns, rate in _of_one_rate(rates):
        rows[:, columns].add_(moves[:, columns], alpha=-rate * scale)


def _of_one_rate(rates: list[float]) -> list[tuple[slice, float]]:
    """Neighbouring columns of one rate."""
    starts = [k for k in range(len(rates)) if k == 0 or rates[k] != rates[k - 1]]
    return [(slice(a, b), rates[a]) for a, b in zip(starts, [*starts[1:], len(rates)], strict=True)]
