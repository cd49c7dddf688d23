"""Tables of one map: the same cells by slabs on the host and by one kernel, both those of a brute-force search."""

import contextlib

import numpy as np
import pytest

from device_path import device_path
from oracles.evidence import nearest_brute_force
from voxjax._runtime.tables import reserve
from voxjax.ops.evidence.map_tables import code_table, nearest_table
from voxjax.ops.evidence.nearest import split_keys
from voxjax.ops.evidence.scoring import CONFLICT, HIT, NEUTRAL, NOTHING

SHAPE = (9, 7, 5)


@pytest.mark.parametrize("form", [contextlib.nullcontext, device_path])
def test_cells_of_the_map_are_those_of_the_definition(form) -> None:
    rng = np.random.default_rng(0)
    states = rng.choice(np.asarray([0, 1, 1, 1, 1, 1, 1, 2], np.uint8), SHAPE)
    index, num_cells = np.argwhere(states == 2).astype(np.int32), int(np.prod(SHAPE))
    with form():
        keys = nearest_table(index, SHAPE, radius=5)
        flat = reserve(len(keys), dtype=np.uint8)
        flat[:num_cells] = states.reshape(-1)
        codes = np.asarray(code_table(flat, keys, num_cells, hit_sq=2, clear_sq=4))
    assert len(codes) == len(keys)
    row, squared = (np.asarray(part)[:num_cells] for part in split_keys(np.asarray(keys)))
    expected_squared, expected_row = nearest_brute_force(index, SHAPE, 5)
    np.testing.assert_array_equal(squared, expected_squared)
    np.testing.assert_array_equal(row[expected_row >= 0], expected_row[expected_row >= 0])
    is_free = states.reshape(-1) == 1
    undecided = np.where(is_free, np.where(squared >= 4, CONFLICT, NEUTRAL), NOTHING)
    np.testing.assert_array_equal(codes[:num_cells], np.where(squared <= 2, HIT, undecided))
