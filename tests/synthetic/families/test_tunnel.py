"""Tunnels."""

import numpy as np

from voxjax.synthetic.families import make_place
from voxjax.synthetic.scene import measure_ranges


def test_no_ray_leaves_a_tunnel_but_through_its_ends():
    for seed in range(4):
        place = make_place("tunnel", seed)
        solids = place.scene(np.random.default_rng(0)).solids
        rng = np.random.default_rng(1)
        directions = rng.normal(size=(400, 3)) * (1.0, 1.0, 0.6)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        for at in place.path[20:55:10]:
            ranges = measure_ranges(solids, at, directions)
            assert (ranges < 60.0).mean() > 0.99


def test_kinds_of_tunnels_differ_in_roughness_and_both_have_niches():
    places = [make_place("tunnel", seed) for seed in range(8)]
    tops = [np.std([part[2] for part in place.fixed if part[3] == "floor"]) for place in places]
    assert min(tops) == 0.0
    assert max(tops) > 0.03
    assert all(sum(part[3] == "wall" for part in place.fixed) > 2 * 75 + 10 for place in places)
