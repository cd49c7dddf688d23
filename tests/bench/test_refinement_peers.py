"""Peers of the benchmark of refinement that are not installed."""

import pytest
from bench.refinement_peers import load_refiners
from hidden_packages import hide

from voxjax import InputError


def test_a_missing_peer_is_refused_with_the_way_to_install_it(monkeypatch):
    hide(monkeypatch, "open3d")
    with pytest.raises(InputError, match="pip install open3d-cpu"):
        load_refiners(["open3d"])
    assert [r.module for r in load_refiners([])] == [None, None, None]
