import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax._checks import InputError
from voxjax.ops.moments import surface_moments
from voxjax.ops.window_bits import GROUP, ball_offsets, pack_states, window_sums

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


def _block(seed, margin, density):
    """A block with an empty border as wide as the margin, and the voxels inside the border."""
    rng = np.random.default_rng(seed)
    shape = (3 + 2 * margin, 4 + 2 * margin, GROUP * -(-(11 + 2 * margin) // GROUP))
    states = np.zeros(shape, np.uint8)
    inner = (slice(margin, margin + 3), slice(margin, margin + 4), slice(margin, margin + 11))
    states[inner] = rng.choice(3, (3, 4, 11), p=[1 - density, density / 2, density / 2])
    return states, np.argwhere(np.ones((3, 4, 11))).astype(np.int32)


@pytest.mark.parametrize(("size", "margin"), [(1, 1), (3, 1), (7, 4), (7, 5), (9, 12)])
@pytest.mark.parametrize("density", [0.3, 1.0])
def test_sums_equal_those_over_the_voxels_of_the_ball(size, margin, density):
    states, index = _block(size, margin, density)
    packed = pack_states(jnp.asarray(states.reshape(-1)), np.asarray(states.shape, np.int32), margin=margin)
    group = packed.steps(index[:, 0] + margin, index[:, 1] + margin) + index[:, 2] // GROUP
    shift = (index[:, 2] % GROUP + margin - size // 2).astype(np.uint32)
    summed = jax.jit(window_sums, static_argnames="size")
    sums = np.asarray(summed(packed, group, jnp.asarray(shift), size=size))
    offsets = ball_offsets(size).astype(np.int64)
    places = index[:, None] + margin + offsets[None]
    window = states[tuple(np.moveaxis(places, -1, 0))]
    weights = np.stack([np.prod(offsets ** np.asarray(power), axis=1) for power in _POWERS], axis=1)
    np.testing.assert_array_equal(sums[:10].T, (window == 2) @ weights)
    np.testing.assert_array_equal(sums[10:].T, (window == 1) @ weights[:, :4])


def test_windows_that_no_word_holds_are_refused():
    with pytest.raises(InputError, match=r"at most 25 voxels.*reaches 13 voxels"):
        surface_moments(np.zeros((3, 3, 3), np.uint8), np.zeros((1, 3), np.int32), size=27)
