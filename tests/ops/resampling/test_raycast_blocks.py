"""Rays cast in boxes of their own, joined: the same free space as in one dense box."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax._checks import InputError
from voxjax._types import FREE, OCCUPIED, UNKNOWN
from voxjax.ops.blocks.words import BLOCK
from voxjax.ops.resampling import raycast_blocks
from voxjax.ops.resampling.raycast import crossed_voxels
from voxjax.ops.resampling.raycast_blocks import states_of_rays


@given(seed=st.integers(0, 2**32 - 1), most=st.sampled_from([1, 4 * BLOCK**3, 64 * BLOCK**3, 1 << 24]))
@settings(max_examples=20, deadline=None)
def test_joined_boxes_free_what_one_box_does(seed, most):
    rng = np.random.default_rng(seed)
    x, y, z = rng.integers(1, 70, 3).tolist()
    shape = (x, y, z)
    low = rng.integers(-1000, 1000, 3)
    starts, ends = low + rng.uniform(0, 1, (2, rng.integers(1, 60), 3)) * shape
    is_hit = rng.uniform(size=len(starts)) < 0.7
    found = states_of_rays(starts, ends, is_hit, shape, low=low, advice="give less", most=most)
    expected = np.where(crossed_voxels(starts, ends, shape, low=low), FREE, UNKNOWN)
    expected[tuple((np.floor(ends[is_hit]).astype(int) - low).T)] = OCCUPIED
    np.testing.assert_array_equal(found.dense(), expected)


def test_groups_hold_each_ray_once_and_fit():
    rng = np.random.default_rng(1)
    begin = rng.integers(0, 50, (500, 3))
    end = begin + rng.integers(1, 6, (500, 3))
    groups = list(raycast_blocks._near_each_other(begin, end, 1000))
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(500))
    assert len(groups) > 1
    for rays in groups:
        assert (end[rays].max(axis=0) - begin[rays].min(axis=0)).prod() <= 1000
    # Equal rays cannot be told apart by where they lie.
    same = [np.zeros((7, 3), np.int64), np.full((7, 3), 9, np.int64)]
    assert [len(rays) for rays in raycast_blocks._near_each_other(same[0], same[1], 729)] == [7]


def test_blocks_that_do_not_fit_are_refused_before_they_are_made(monkeypatch):
    rng = np.random.default_rng(2)
    starts, ends = rng.uniform(0, 200, (2, 4000, 3))

    def cast():
        low, is_hit = np.zeros(3, np.int64), np.ones(4000, bool)
        return states_of_rays(
            starts, ends, is_hit, (200, 200, 200), low=low, advice="give less", most=1 << 20
        )

    num_blocks = np.count_nonzero(cast().table)
    needs = []
    monkeypatch.setattr(
        raycast_blocks, "check_memory", lambda need, what, *a, **k: needs.append((need, what))
    )
    cast()
    (boxes, _), (blocks, what) = needs
    assert boxes >= 5 << 20
    assert 0.9 * num_blocks < blocks / BLOCK**3 <= num_blocks
    assert what == f"a grid of {round(blocks / BLOCK**3):,} blocks of 8 x 8 x 8 voxels"


@pytest.mark.parametrize("limit", ["0.05", "0.0001"])
def test_memory_that_does_not_suffice_is_one_sentence(monkeypatch, limit):
    monkeypatch.setenv("VOXJAX_MEMORY", limit)
    starts, ends = np.random.default_rng(3).uniform(0, 200, (2, 100, 3))
    with pytest.raises(
        InputError, match=r"boxes of .* voxels, in which rays are cast, needs about .*give less"
    ):
        states_of_rays(
            starts, ends, np.ones(100, bool), (200, 200, 200), low=np.zeros(3, np.int64), advice="give less"
        )
