import numpy as np
import pytest

import voxjax as vx
from compilations import assert_compiles_nothing
from near_fields import field_of
from oracles.evidence import nearest_brute_force
from voxjax.ops.evidence.nearest import NOTHING_NEAR, nearest_field, split_keys


@pytest.mark.parametrize("dims", [(9, 7, 5), (1, 1, 12), (1, 1, 1)])
@pytest.mark.parametrize("radius", [1, 3, 5, 7])
def test_field_equals_brute_force(dims, radius):
    rng = np.random.default_rng(radius)
    cells = rng.permutation(int(np.prod(dims)))[: max(int(np.prod(dims)) // 40, 1)]
    index = np.stack(np.unravel_index(np.sort(cells), dims), -1).astype(np.int32)
    row, squared = map(np.asarray, split_keys(field_of(index, dims, radius)))
    expected_squared, expected_row = nearest_brute_force(index, dims, radius)
    np.testing.assert_array_equal(squared, expected_squared)
    is_near = expected_row >= 0
    np.testing.assert_array_equal(row[is_near], expected_row[is_near])


def test_padding_rows_and_padding_cells_hold_nothing():
    index = np.asarray([[4, 4, 4]], np.int32)
    field = np.asarray(field_of(index, (5, 5, 5), 2, flat_size=200))
    assert (field[125:] == NOTHING_NEAR).all()
    assert field.reshape(-1)[0] == NOTHING_NEAR  # the padding rows lie at (0, 0, 0)


def test_no_voxels_give_an_empty_field():
    field = field_of(np.zeros((0, 3), np.int32), (3, 3, 3), 2)
    assert (np.asarray(field) == NOTHING_NEAR).all()


def test_new_dims_compile_nothing():
    index = np.asarray([[1, 1, 1]], np.int32)
    field_of(index, (4, 5, 6), 2, flat_size=256)
    with assert_compiles_nothing(nearest_field):
        field_of(index, (6, 4, 5), 2, flat_size=256)


def test_radius_outside_the_key_is_refused():
    with pytest.raises(vx.InputError, match="radius"):
        field_of(np.zeros((1, 3), np.int32), (3, 3, 3), 8)
