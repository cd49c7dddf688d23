import jax.numpy as jnp
import numpy as np
import pytest

from occupied_grids import SHAPES, blocks_of, random_grid
from voxjax.ops.blocks.words import block_lattice, lattice_of_words, occupied_blocks, pack_words


def _unpacked(words, shape):
    """The grid that words were packed from, and whether their margin is empty."""
    bits = (np.asarray(words)[..., None] >> np.arange(32, dtype=np.uint32)) & 1
    bits = bits.reshape(*bits.shape[:2], -1)
    inner = tuple(slice(low, low + side) for low, side in zip((8, 8, 32), shape, strict=True))
    return bits[inner] != 0, bits.sum() == bits[inner].sum()


@pytest.mark.parametrize("put", [np.asarray, jnp.asarray], ids=["host", "device"])
@pytest.mark.parametrize("shape", SHAPES)
def test_packed_bits_are_the_voxels_in_an_empty_margin(shape, put):
    occupied = random_grid(shape, 0.4)
    words = pack_words(put(occupied))
    assert words.dtype == np.uint32
    assert words.shape == (-(-shape[0] // 8) * 8 + 16, -(-shape[1] // 8) * 8 + 16, -(-shape[2] // 32) + 2)
    assert lattice_of_words(words) == block_lattice(shape)
    unpacked, margin_is_empty = _unpacked(words, shape)
    np.testing.assert_array_equal(unpacked, occupied)
    assert margin_is_empty


@pytest.mark.parametrize("put", [np.asarray, jnp.asarray], ids=["host", "device"])
def test_any_byte_above_zero_is_occupied(put):
    grid = np.arange(256, dtype=np.uint8).reshape(2, 4, 32)
    np.testing.assert_array_equal(_unpacked(pack_words(put(grid)), grid.shape)[0], grid > 0)


@pytest.mark.parametrize("shape", SHAPES)
def test_occupied_blocks_are_those_that_hold_a_voxel(shape):
    occupied = random_grid(shape, 0.02, seed=sum(shape))
    flags = np.asarray(occupied_blocks(pack_words(occupied)))
    assert flags.shape == block_lattice(occupied.shape)
    assert [tuple(place) for place in np.argwhere(flags).tolist()] == blocks_of(occupied)
