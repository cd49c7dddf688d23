"""Large halls."""

import numpy as np

from voxjax.synthetic.families import make_place
from voxjax.synthetic.scene import measure_ranges


def test_columns_stand_one_bay_apart_and_no_ray_leaves_the_hall():
    place = make_place("hall", 1)
    columns = np.asarray([part[0].mean(axis=0) for part in place.fixed if part[3] == "column"])
    assert len(np.unique(columns[:, 1].round(6))) == 2
    steps = np.diff(np.unique(columns[:, 0].round(6)))
    bays = np.rint(steps / steps.min())
    np.testing.assert_allclose(steps, bays * steps.min(), rtol=1e-6)
    solids = place.scene(np.random.default_rng(0)).solids
    directions = np.random.default_rng(1).normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for at in place.path:
        assert np.isfinite(measure_ranges(solids, at, directions)).all()


def test_things_stand_between_the_rows_of_columns():
    place = make_place("hall", 2)
    walls = np.concatenate([part[0] for part in place.fixed if part[3] == "wall"])
    things = [part for usual, _ in place.pieces for part in usual]
    assert len(things) > 15
    middles = np.asarray([part[0].mean(axis=0) for part in things])
    assert (middles > walls.min(axis=0) + 1.0).all()
    assert (middles < walls.max(axis=0) - 0.1).all()
