"""The same answers from a dense array, from its blocks and from chunks."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes
from tests.ops.blocks.test_chunked_array import chunked

from voxjax import InputError
from voxjax.ops.blocks import kept
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of

DENSE = random_boxes((40, 25, 33), seed=6)

KINDS = {
    "dense": lambda: DENSE.copy(),
    "blocks": lambda: blocks_of(DENSE),
    "chunks": lambda: chunked(DENSE, (16, 9, 24))[0],
}


@pytest.fixture(params=list(KINDS.values()), ids=list(KINDS))
def values(request):
    return request.param()


def test_parts_and_voxels(values):
    low, high = np.array([3, 4, 5]), np.array([30, 21, 33])
    expected = DENSE[3:30, 4:21, 5:33]
    np.testing.assert_array_equal(kept.window(values, (3, 4, 5), (30, 21, 33)), expected)
    np.testing.assert_array_equal(kept.part(values, low, high), expected)
    np.testing.assert_array_equal(
        kept.take(values, np.array([[3, 4, 5], [39, 24, 32]])), DENSE[[3, 39], [4, 24], [5, 32]]
    )
    assert isinstance(kept.in_blocks(values), BlockArray)
    np.testing.assert_array_equal(kept.in_blocks(values), DENSE)


def test_what_is_held_where(values):
    for value in (1, 2):
        assert kept.count(values, np.uint8(value)) == np.count_nonzero(DENSE == value)
        np.testing.assert_array_equal(
            kept.where(values, np.uint8(value), "such"), np.argwhere(DENSE == value)
        )
    places = np.argwhere(DENSE)
    low, high = kept.known_box(values)
    assert (low.tolist(), high.tolist()) == (places.min(axis=0).tolist(), (places.max(axis=0) + 1).tolist())


def test_cubes_that_hold_something_are_found(values):
    found = kept.cubes_of(values, 16)
    assert found.shape == (3, 2, 3)
    assert found[tuple(np.argwhere(DENSE).T // 16)].all()
    if isinstance(values, BlockArray):
        assert np.argwhere(found).tolist() == np.unique(np.argwhere(DENSE) // 16, axis=0).tolist()


def test_arrays_are_the_same_however_they_are_kept(values):
    other = DENSE.copy()
    other[5, 6, 7] ^= 1
    for make in KINDS.values():
        assert kept.same(values, make())
    assert not kept.same(values, other)
    assert not kept.same(blocks_of(other), values)
    assert not kept.same(values, None)
    assert kept.same(None, None)


def test_values_that_can_be_checked_are_all_there_are():
    assert kept.checkable(DENSE) is DENSE
    assert np.unique(kept.checkable(KINDS["blocks"]())).tolist() == [0, 1, 2]
    array, reads = chunked(DENSE, (16, 9, 24))
    assert kept.checkable(array).size == 0
    assert not reads


def test_lists_that_no_memory_holds_are_refused(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.001")
    with pytest.raises(InputError, match=r"the list of 4,251,528 occupied voxels needs about 0\.051 GB"):
        kept.where(np.full((162, 162, 162), 2, np.uint8), np.uint8(2), "occupied")
