import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from voxjax.ops.bits import SPREAD, WORD, pack_bits, pack_spread


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(bool, st.sampled_from([1, 31, 64, 70])))
def test_words_are_those_of_numpy(bits):
    words = np.asarray(pack_bits(bits))
    assert words.dtype == np.uint32
    assert words.shape == (-(-len(bits) // WORD),)
    padded = np.pad(bits, (0, -len(bits) % WORD))
    np.testing.assert_array_equal(words, np.packbits(padded, bitorder="little").view("<u4"))


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(np.uint8, 70, elements=st.sampled_from([0, 1, 2, 127, 128, 255])))
def test_bytes_are_set_where_they_are_not_zero(values):
    np.testing.assert_array_equal(pack_bits(values), pack_bits(values != 0))


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(bool, st.sampled_from([1, 48, 70])), st.sampled_from([1, 4]))
def test_spread_words_hold_four_bits_a_byte(bits, multiple):
    words = np.asarray(pack_spread(bits, multiple))
    assert words.dtype == np.uint32
    assert len(words) % multiple == 0
    unpacked = np.unpackbits(words.astype("<u4").view(np.uint8)[:, None], axis=1, bitorder="little")
    assert not unpacked[:, 4:].any()
    voxels = unpacked[:, :4].reshape(-1)
    assert len(voxels) == SPREAD * len(words)
    np.testing.assert_array_equal(voxels[: len(bits)], bits)
    assert not voxels[len(bits) :].any()


@pytest.mark.parametrize("pack", [pack_bits, pack_spread])
def test_no_bits_make_no_words(pack):
    assert pack(np.zeros(0, bool)).shape == (0,)
