"""The choice of a device: what is wanted, what is there, and what a trial says of it."""

import pytest
import torch

from goc.device import CPU, FIRST, choose_device, working_device
from goc.errors import EngineError
from goc.events import Warned


def refused(device):
    raise AssertionError("nothing is to be tried")


def test_the_processor_needs_no_trial(monkeypatch):
    for there in (True, False):
        monkeypatch.setattr(torch.cuda, "is_available", lambda there=there: there)
        assert choose_device("cpu", refused) == CPU
    assert choose_device("auto", refused) == CPU  # no device is there


@pytest.mark.parametrize("wanted", ["auto", "cuda"])
def test_a_device_that_passes_its_trial_computes(monkeypatch, wanted):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    tried, heard = [], []
    assert choose_device(wanted, tried.append, heard.append) == FIRST
    assert tried == [FIRST] and heard == []


def test_a_device_that_fails_is_told_of_where_it_is_not_asked_for_and_refused_where_it_is(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    heard = []
    assert choose_device("auto", lambda device: "its fan is stuck", heard.append) == CPU
    (warning,) = heard
    assert isinstance(warning, Warned) and "the processor computes: its fan is stuck." in warning.message
    with pytest.raises(EngineError, match=r"--device cuda cannot run here: its fan is stuck\..*--device cpu needs"):
        choose_device("cuda", lambda device: "its fan is stuck")


def test_without_a_device_cuda_is_refused(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(EngineError, match="--device cuda cannot run here: PyTorch sees no CUDA device"):
        choose_device("cuda", refused)
    assert working_device() == CPU


def test_a_driver_that_does_not_fit_leaves_the_processor(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)  # and no kernel runs: this PyTorch has none
    assert working_device() == working_device("cpu") == CPU
