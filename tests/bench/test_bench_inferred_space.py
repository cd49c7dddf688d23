"""Figures of inferred free space, on a small building."""

import numpy as np
from bench.inferred_space import compared, timed

import small_worlds


def test_what_is_inferred_is_compared_with_what_was_seen():
    found = compared(small_worlds.draw_map())
    assert found["voxels"] == np.prod(small_worlds.draw_map().shape)
    assert found["precision"] > 0.9
    assert 0.6 < found["recall"] <= 1.0


def test_a_cloud_says_where_its_free_space_is_from_and_takes_time():
    cloud = small_worlds.draw_map()
    found = timed(cloud, rounds=1)
    assert found["free_space"] == "observed"
    assert found["occupied"] == cloud.num_occupied
    assert float(found["infer_s"]) > 0.0
    assert float(found["features_s"]) > 0.0
