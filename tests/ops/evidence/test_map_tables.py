"""Tables of one map: what their cells hold, and that they share lengths."""

import jax.numpy as jnp
import numpy as np

from oracles.evidence import nearest_brute_force
from voxjax._runtime.tables import table_lengths
from voxjax.ops.evidence.map_tables import code_table, nearest_table
from voxjax.ops.evidence.nearest import split_keys

SHAPE, RADIUS = (6, 5, 7), 3


def test_cells_of_a_table_hold_the_nearest_voxel_and_what_it_means():
    rng = np.random.default_rng(0)
    states = rng.choice(3, SHAPE, p=[0.3, 0.6, 0.1]).astype(np.uint8)
    index, size = np.argwhere(states == 2).astype(np.int32), states.size
    keys = nearest_table(index, SHAPE, radius=RADIUS)
    assert len(keys) == table_lengths(size, len(index))[0]
    squared, row = nearest_brute_force(index, SHAPE, RADIUS)
    found_row, found_squared = map(np.asarray, split_keys(keys[:size]))
    np.testing.assert_array_equal(np.minimum(found_squared, 63), squared)
    np.testing.assert_array_equal(found_row[row >= 0], row[row >= 0])
    flat = np.zeros(len(keys), np.uint8)
    flat[:size] = states.reshape(-1)
    codes = np.asarray(code_table(jnp.asarray(flat), keys, size, hit_sq=2, clear_sq=4))
    is_free = states.reshape(-1) == 1
    expected = np.where(squared <= 2, 1, np.where(is_free, np.where(squared >= 4, 3, 2), 0))
    np.testing.assert_array_equal(codes[:size], expected)


def test_maps_of_two_shapes_have_tables_of_one_length():
    lengths = {
        len(nearest_table(np.zeros((1, 3), np.int32), shape, radius=2)) for shape in (SHAPE, (3, 9, 4))
    }
    assert len(lengths) == 1
