import itertools

import numpy as np

from voxjax.refinement.problems.joint_pairs import connected_parts, overlapping_pairs


def test_maps_that_overlap_are_found(team):
    maps, _, starts, _ = team
    poses = np.asarray(starts, np.float32)
    assert overlapping_pairs([*maps, None], np.concatenate([poses, poses[:1]])) == list(
        itertools.combinations(range(4), 2)
    )
    np.testing.assert_array_equal(connected_parts(6, [(4, 2), (5, 3), (2, 5)]), [0, 1, 2, 2, 2, 2])
