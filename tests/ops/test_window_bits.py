import jax
import numpy as np
import pytest

from voxjax._checks import InputError
from voxjax.ops.surface.ball_sums import ball_offsets, window_sums
from voxjax.ops.surface.moments import surface_moments
from voxjax.ops.surface.packed_states import PackedStates, pack_on_host, pack_states

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


def _sums(states, index, size, margin, pack):
    packed = PackedStates(*(jax.device_put(a) for a in pack(states, margin=margin)))

    @jax.jit
    def summed(packed, voxels):
        group, shift = packed.place(voxels, margin=margin)
        return window_sums(packed, group, shift + np.uint32(margin - size // 2), size=size)

    return np.asarray(summed(packed, index.T))


@pytest.mark.parametrize("pack", [pack_states, pack_on_host])
@pytest.mark.parametrize(("size", "margin"), [(1, 1), (3, 1), (7, 4), (7, 5), (9, 12), (5, 8)])
@pytest.mark.parametrize(("shape", "density"), [((3, 4, 11), 0.3), ((2, 1, 24), 0.6), ((4, 3, 1), 1.0)])
def test_sums_equal_those_over_the_voxels_of_the_ball(shape, density, size, margin, pack):
    rng = np.random.default_rng(size)
    states = rng.choice(3, shape, p=[1 - density, density / 2, density / 2]).astype(np.uint8)
    index = np.argwhere(np.ones(shape)).astype(np.int32)
    sums = _sums(states, index, size, margin, pack)
    offsets = ball_offsets(size).astype(np.int64)
    wide = np.pad(states, size // 2)
    window = wide[tuple(np.moveaxis(index[:, None] + size // 2 + offsets[None], -1, 0))]
    weights = np.stack([np.prod(offsets ** np.asarray(power), axis=1) for power in _POWERS], axis=1)
    np.testing.assert_array_equal(sums[:10].T, (window == 2) @ weights)
    np.testing.assert_array_equal(sums[10:].T, (window == 1) @ weights[:, :4])


def test_the_host_packs_views_and_many_slabs_alike(monkeypatch):
    states = np.random.default_rng(0).integers(0, 3, (9, 7, 30)).astype(np.uint8)
    monkeypatch.setattr("voxjax.ops.surface.packed_states._SLAB", 500)
    for view in (states[::2, 1:, 3:], np.asfortranarray(states), states.transpose(1, 2, 0)):
        on_host, on_device = pack_on_host(view, margin=3), pack_states(view, margin=3)
        index = np.argwhere(np.ones(view.shape)).astype(np.int32)
        assert int(on_host.depth) == int(on_device.depth)
        assert int(on_host.height) == int(on_device.height)
        ones, others = (_sums(view, index, 3, 3, pack) for pack in (pack_on_host, pack_states))
        np.testing.assert_array_equal(ones, others)


def test_windows_that_no_word_holds_are_refused():
    with pytest.raises(InputError, match=r"at most 25 voxels.*reaches 13 voxels"):
        surface_moments(np.zeros((3, 3, 3), np.uint8), np.zeros((1, 3), np.int32), size=27)
