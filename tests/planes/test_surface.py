"""Which elements of a surface touch."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from voxjax.planes.surface import neighbour_pairs


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 0.9))
def test_pairs_are_all_voxels_that_touch(seed, share):
    index = np.argwhere(np.random.default_rng(seed).random((5, 4, 6)) < share).astype(np.int32)
    ours = {tuple(pair) for pair in neighbour_pairs(index).tolist()}
    gap = np.abs(index[:, None] - index[None]).max(axis=2) if len(index) else np.zeros((0, 0))
    assert ours == {(i, j) for i, j in np.argwhere(gap == 1).tolist() if i < j}
