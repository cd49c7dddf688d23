"""Trees."""

import numpy as np

from voxjax.synthetic.families.trees import make_tree


def test_a_tree_has_a_trunk_and_a_crown_above_its_clear_height():
    for seed in range(20):
        trunk, *crown = make_tree(np.random.default_rng(seed), height=10.0, clear=3.0)
        assert trunk[1] < 0.0
        assert trunk[2] == 8.0
        assert 3 <= len(crown) <= 5
        assert all(low > 1.5 and high < 11.5 for _, low, high, _ in crown)
        assert max(np.ptp(part[0], axis=0).max() for part in crown) > 0.5
