import numpy as np
import pytest

from packed_sums import packed_sums
from voxjax._checks import InputError
from voxjax.ops.surface.moments import surface_moments
from voxjax.ops.surface.packed_states import pack_on_host, pack_states


def test_the_host_packs_views_and_many_slabs_alike(monkeypatch):
    states = np.random.default_rng(0).integers(0, 3, (9, 7, 30)).astype(np.uint8)
    monkeypatch.setattr("voxjax.ops.surface.packed_states._SLAB", 500)
    for view in (states[::2, 1:, 3:], np.asfortranarray(states), states.transpose(1, 2, 0)):
        on_host, on_device = pack_on_host(view, margin=3), pack_states(view, margin=3)
        index = np.argwhere(np.ones(view.shape)).astype(np.int32)
        assert int(on_host.depth) == int(on_device.depth)
        assert int(on_host.height) == int(on_device.height)
        ones, others = (packed_sums(view, index, 3, 3, pack) for pack in (pack_on_host, pack_states))
        np.testing.assert_array_equal(ones, others)


def test_windows_that_no_word_holds_are_refused():
    with pytest.raises(InputError, match=r"at most 25 voxels.*reaches 13 voxels"):
        surface_moments(np.zeros((3, 3, 3), np.uint8), np.zeros((1, 3), np.int32), size=27)
