"""Rolling ground."""

import numpy as np

from voxjax.synthetic.ground import Ground


def test_rays_end_on_the_ground_and_meet_it_nowhere_before():
    rng = np.random.default_rng(0)
    ground = Ground(rng, 80.0, 3.0)
    origin = np.asarray([40.0, 40.0, float(ground.at(np.asarray([[40.0, 40.0]]))[0]) + 1.5])
    directions = rng.normal(size=(500, 3)) * (1.0, 1.0, 0.2)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    ranges = ground.ranges(origin, directions, 30.0)
    is_met = np.isfinite(ranges)
    assert 100 < is_met.sum() < 500
    ends = origin + ranges[is_met, None] * directions[is_met]
    assert np.abs(ends[:, 2] - ground.at(ends[:, :2])).max() < 0.03
    for share in (0.25, 0.5, 0.75, 0.95):
        inside = origin + share * ranges[is_met, None] * directions[is_met]
        assert (inside[:, 2] - ground.at(inside[:, :2])).min() > -0.12
    ends = origin + 30.0 * directions[~is_met]
    assert (ends[:, 2] > ground.at(ends[:, :2]) - 0.12).all()


def test_the_relief_is_the_deviation_of_the_height():
    heights = Ground(np.random.default_rng(1), 100.0, 5.0).at(
        np.random.default_rng(2).uniform(0.0, 100.0, (4000, 2))
    )
    np.testing.assert_allclose(heights.std(), 5.0, rtol=0.15)
