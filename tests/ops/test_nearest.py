import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import voxjax as vx
from compilations import assert_compiles_nothing
from oracles.evidence import nearest_brute_force
from voxjax.ops.evidence import nearest_host
from voxjax.ops.evidence.nearest import NOTHING_NEAR, nearest_field, split_keys
from voxjax.ops.evidence.nearest_host import evidence_codes_on_host, nearest_field_on_host
from voxjax.ops.evidence.scoring import evidence_codes


def field_of(index, dims, radius, flat_size=None):
    size = int(np.prod(dims)) if flat_size is None else flat_size
    padded = np.concatenate([index, np.zeros((3, 3), np.int32)]).astype(np.int32)
    mask = np.arange(len(padded)) < len(index)
    return nearest_field(padded, mask, np.asarray(dims, np.int32), flat_size=size, radius=radius)


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


@settings(max_examples=25, deadline=None)
@given(shape=st.tuples(*[st.integers(1, 14)] * 3), radius=st.integers(1, 5), seed=st.integers(0, 99))
def test_host_and_device_give_the_same_bits(shape, radius, seed):
    rng = np.random.default_rng(seed)
    index = np.argwhere(rng.random(shape) < rng.choice([0.0, 0.02, 0.5])).astype(np.int32)
    size = int(np.prod(shape))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nearest_host, "SLAB", int(rng.choice([1, 64, 1 << 16])))
        found = nearest_field_on_host(index, shape, length=size + 7, radius=radius)
    assert (found[size:] == 0).all()
    expected = np.full(size, NOTHING_NEAR)
    if len(index):
        expected = np.asarray(field_of(index, shape, radius))
    assert (found[:size] == expected).all()


def test_host_codes_equal_the_definition():
    rng = np.random.default_rng(0)
    states = rng.integers(0, 3, 5000).astype(np.uint8)
    keys = rng.integers(0, 2**32, 5000, dtype=np.uint64).astype(np.uint32)
    for hit_sq, clear_sq in ((2, 4), (0, 1), (20, 25)):
        found = evidence_codes_on_host(states, keys, hit_sq, clear_sq, length=6000)
        assert (found[:5000] == np.asarray(evidence_codes(states, keys, hit_sq, clear_sq))).all()
        assert (found[5000:] == 0).all()


def test_host_says_what_it_cannot_do():
    with pytest.raises(vx.InputError, match=r"radius must be 1 to 5 voxels, got 6"):
        nearest_field_on_host(np.zeros((1, 3), np.int32), (2, 2, 2), length=8, radius=6)
