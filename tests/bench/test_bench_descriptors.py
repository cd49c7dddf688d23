"""The benchmark of hypotheses from local descriptors."""

import numpy as np

from bench import descriptors
from small_worlds import draw_map, pose
from voxjax.matching.descriptors import describe_map


def test_both_maps_are_described_from_the_coarser_of_their_levels_on(monkeypatch):
    T = pose(yaw=20.0, translation=(1.0, 2.0, 0.0))
    a, b = draw_map(), draw_map(T)
    said = []

    def described(grid, **options):
        said.append(options["finest"])
        return describe_map(grid, **options)

    monkeypatch.setattr(descriptors, "describe_map", described)
    monkeypatch.setattr(descriptors, "finest_level", lambda grid, *, spacing: int(grid is b))
    columns, _ = descriptors._hypotheses(a, b, np.linalg.inv(T), b.occupied_points().mean(axis=0))
    assert set(said) == {1}
    assert columns.split()[0] in ("yes", "no")
