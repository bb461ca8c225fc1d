"""A cluster that isn't there, and work that is lost."""

import os
import sys
from concurrent.futures import CancelledError

import pytest

from swim2real.comparison.executors import dask, explained
from swim2real.errors import ArgumentError, MissingExtraError, RunError


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("local:0", "cluster is 'local:0'; write local:N with a whole number N from 1 on"),
        ("local:two", "cluster is 'local:two'; write local:N with a whole number N from 1 on"),
        ("here", "cluster is 'here'; write tcp://HOST:PORT of a Dask scheduler, or local:N"),
    ],
)
def test_an_address_that_makes_no_sense_is_named(address, says):
    with pytest.raises(ArgumentError, match=says), dask(address, os.getpid, lambda found: None):
        pass


def test_without_dask_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    says = r"a Dask cluster needs dask and distributed; install them with: pip install 'swim2real\[cluster\]'"
    with pytest.raises(MissingExtraError, match=says), dask("local:2", os.getpid, lambda found: None):
        pass


def test_lost_work_is_explained():
    assert explained(RunError("its process died")) == "its process died"
    assert explained(CancelledError()) == "the cluster gave it up; run again to go on"
    assert explained(ValueError("what?")) == "unexpected ValueError: what?"
