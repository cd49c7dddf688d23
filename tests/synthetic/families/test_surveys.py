"""How two robots map."""

import numpy as np

from voxjax.synthetic.families import make_place
from voxjax.synthetic.families.surveys import alike, part_of_many, single_scans, unlike

PLACE = make_place("garage", 0)


def _draws(draw):
    return [draw(np.random.default_rng(seed), PLACE) for seed in range(40)]


def test_like_robots_have_one_voxel_size_and_unlike_noise():
    for a, b in _draws(alike):
        assert a.voxel_size == b.voxel_size
        assert 0.8 * PLACE.voxel_size < a.voxel_size < 1.3 * PLACE.voxel_size
        assert a.sensor.range_noise != b.sensor.range_noise
        assert a.drift < a.voxel_size


def test_single_scans_meet_single_scans_and_maps_of_many():
    extents = [(a.extent > 0.0, b.extent > 0.0) for a, b in _draws(single_scans)]
    assert set(extents) == {(False, False), (False, True), (True, False)}


def test_one_map_is_a_part_of_what_the_other_covers():
    ratios = [a.extent / b.extent for a, b in _draws(part_of_many)]
    assert all(max(ratio, 1.0 / ratio) > 2.5 for ratio in ratios)
    assert min(ratios) < 1.0 < max(ratios)


def test_unlike_robots_differ_in_sensor_and_voxel_size():
    ratios = []
    for a, b in _draws(unlike):
        assert len(a.sensor.directions()) != len(b.sensor.directions())
        ratios.append(a.voxel_size / b.voxel_size)
    assert min(ratios) < 0.8
    assert max(ratios) > 1.25
    assert all(max(ratio, 1.0 / ratio) > 1.15 for ratio in ratios)
