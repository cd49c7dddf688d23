import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import voxjax as vx
from near_fields import field_of
from voxjax.ops.evidence import nearest_host
from voxjax.ops.evidence.nearest import INDEX_BITS, NOTHING_NEAR
from voxjax.ops.evidence.nearest_host import evidence_codes_on_host, nearest_field_on_host
from voxjax.ops.evidence.scoring import evidence_codes


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


@pytest.mark.parametrize("slab", [40, 1 << 16])
@pytest.mark.parametrize("shape", [(61, 50, 7), (3, 90, 12), (90, 2, 1)])
def test_columns_far_apart_keep_their_distance(shape, slab, monkeypatch):
    monkeypatch.setattr(nearest_host, "SLAB", slab)
    rng = np.random.default_rng(slab)
    chosen = rng.choice(int(np.prod(shape)), 12, replace=False)
    # Voxels at the borders: beyond them the next line begins.
    ends = [np.prod(shape) - 1, 0, np.ravel_multi_index((1, shape[1] - 1, 0), shape)]
    index = np.argwhere(np.isin(np.arange(np.prod(shape)), [*chosen, *ends]).reshape(shape)).astype(np.int32)
    cells = np.indices(shape).reshape(3, -1).T
    squared = ((cells[:, None] - index[None]) ** 2).sum(axis=2)
    for radius in (1, 4, 5):
        expected = (squared << INDEX_BITS | np.arange(len(index))).min(axis=1)
        expected[squared.min(axis=1) > radius**2] = NOTHING_NEAR
        found = nearest_field_on_host(index, shape, length=len(cells), radius=radius)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("share_free", [0.0, 0.3])
def test_host_codes_equal_the_definition(share_free, monkeypatch):
    monkeypatch.setattr(nearest_host, "SLAB", 700)
    rng = np.random.default_rng(0)
    states = rng.choice(np.asarray([0, 1, 2], np.uint8), 5000, p=[0.6 - share_free, share_free, 0.4])
    keys = rng.integers(0, 2**32, 5000, dtype=np.uint64).astype(np.uint32)
    keys[2000:4000] = NOTHING_NEAR
    for hit_sq, clear_sq in ((2, 4), (0, 1), (20, 25)):
        found = evidence_codes_on_host(states, keys, hit_sq, clear_sq, length=6000)
        assert (found[:5000] == np.asarray(evidence_codes(states, keys, hit_sq, clear_sq))).all()
        assert (found[5000:] == 0).all()


def test_host_says_what_it_cannot_do():
    with pytest.raises(vx.InputError, match=r"radius must be 1 to 5 voxels, got 6"):
        nearest_field_on_host(np.zeros((1, 3), np.int32), (2, 2, 2), length=8, radius=6)
