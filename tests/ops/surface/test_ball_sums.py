import numpy as np
import pytest

from packed_sums import packed_sums
from voxjax.ops.surface.ball_sums import ball_offsets
from voxjax.ops.surface.packed_states import pack_on_host, pack_states

_POWERS = [
    (0, 0, 0),
    (1, 0, 0),
    (0, 1, 0),
    (0, 0, 1),
    (2, 0, 0),
    (0, 2, 0),
    (0, 0, 2),
    (1, 1, 0),
    (1, 0, 1),
    (0, 1, 1),
]


@pytest.mark.parametrize("pack", [pack_states, pack_on_host])
@pytest.mark.parametrize(("size", "margin"), [(1, 1), (3, 1), (7, 4), (7, 5), (9, 12), (5, 8)])
@pytest.mark.parametrize(("shape", "density"), [((3, 4, 11), 0.3), ((2, 1, 24), 0.6), ((4, 3, 1), 1.0)])
def test_sums_equal_those_over_the_voxels_of_the_ball(shape, density, size, margin, pack):
    rng = np.random.default_rng(size)
    states = rng.choice(3, shape, p=[1 - density, density / 2, density / 2]).astype(np.uint8)
    index = np.argwhere(np.ones(shape)).astype(np.int32)
    sums = packed_sums(states, index, size, margin, pack)
    offsets = ball_offsets(size).astype(np.int64)
    wide = np.pad(states, size // 2)
    window = wide[tuple(np.moveaxis(index[:, None] + size // 2 + offsets[None], -1, 0))]
    weights = np.stack([np.prod(offsets ** np.asarray(power), axis=1) for power in _POWERS], axis=1)
    np.testing.assert_array_equal(sums[:10].T, (window == 2) @ weights)
    np.testing.assert_array_equal(sums[10:].T, (window == 1) @ weights[:, :4])
