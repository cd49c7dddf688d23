"""Peers of the benchmark of refinement that are not installed."""

import importlib

import pytest
from bench.refinement_peers import load_refiners

from voxjax import InputError


def test_a_missing_peer_is_refused_with_the_way_to_install_it(monkeypatch):
    real = importlib.import_module

    def without_open3d(name, *rest):
        if name == "open3d":
            raise ImportError("No module named 'open3d'")
        return real(name, *rest)

    monkeypatch.setattr(importlib, "import_module", without_open3d)
    with pytest.raises(InputError, match="pip install open3d-cpu"):
        load_refiners(["open3d"])
    assert [r.module for r in load_refiners([])] == [None, None, None]
