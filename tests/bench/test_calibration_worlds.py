"""Worlds of the calibration: their seeds, and maps without free space."""

from bench.calibration_worlds import KINDS, seeds_of, without_free_space

from small_worlds import draw_map


def test_free_space_is_taken_away_and_nothing_else():
    grid = draw_map()
    cloud = without_free_space(grid)
    assert cloud.num_free == 0
    assert cloud.num_occupied == grid.num_occupied


def test_kinds_share_no_seed():
    taken = [set(seeds_of(kind, 20, 1000)) for kind in KINDS]
    assert all(len(seeds) == 20 for seeds in taken)
    assert not taken[0] & taken[1]
    assert not (taken[0] | taken[1]) & taken[2]
