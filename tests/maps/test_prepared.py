"""Maps prepared for registration."""

import jax
import numpy as np
import pytest

from small_worlds import draw_map
from voxjax.maps.prepared import draw_rows, map_surface, prepare_map
from voxjax.ops.evidence.nearest import split_keys
from voxjax.ops.evidence.scoring import HIT


def test_rows_are_drawn_in_proportion_to_their_weights():
    rows = draw_rows(np.asarray([1.0, 0.0, 3.0]), 400)
    assert np.bincount(rows).tolist() == [100, 0, 300]
    assert draw_rows(np.ones(1), 3).tolist() == [0, 0, 0]


@pytest.mark.parametrize(("voxel_size", "factor"), [(0.12, 3), (0.15, 2), (0.2, 2), (0.4, 2)])
def test_unrefined_poses_are_compared_in_cells_of_about_0_3_m(voxel_size, factor):
    prepared = prepare_map(draw_map(voxel_size=voxel_size))
    assert prepared.coarse_factor == factor
    # Looser than the evidence of refined poses, and no looser than three quarters of a cell.
    hits, coarse_hits = (
        np.asarray(codes) == HIT for codes in (prepared.codes, prepared.coarse_codes(factor))
    )
    assert (coarse_hits >= hits).all()
    squared = np.asarray(split_keys(prepared.keys)[1])
    assert squared[coarse_hits].max() <= (0.75 * factor) ** 2


def test_a_known_surface_gives_the_same_prepared_map():
    grid = draw_map(voxel_size=0.2)
    surface, prepared = map_surface(grid), prepare_map(grid)
    assert surface.free_share == prepared.free_share > 0.5
    again = prepare_map(surface)
    assert again.grid.equals(prepared.grid)
    for found, expected in zip(jax.tree.leaves(again), jax.tree.leaves(prepared), strict=True):
        np.testing.assert_array_equal(found, expected)
