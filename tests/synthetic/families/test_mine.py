"""Mines."""

import numpy as np

from voxjax.synthetic.families import make_place
from voxjax.synthetic.scene import measure_ranges


def test_pillars_are_all_different_and_no_ray_leaves_the_mine():
    place = make_place("mine", 0)
    pillars = [part[0] for part in place.fixed if part[3] == "rock"]
    sides = [np.linalg.norm(np.roll(p, -1, axis=0) - p, axis=1) for p in pillars]
    assert len({tuple(side.round(3)) for side in sides}) == len(pillars)
    solids = place.scene(np.random.default_rng(0)).solids
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(400, 3)) * (1.0, 1.0, 0.4)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for at in place.path:
        assert (measure_ranges(solids, at, directions) < 120.0).mean() > 0.98
