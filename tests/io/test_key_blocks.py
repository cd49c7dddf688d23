"""Blocks on the lattice of keys, against the dense array shifted there."""

import numpy as np
import pytest
from tests.ops.blocks.boxes import random_boxes

from voxjax.io.key_blocks import key_block_codes, key_blocks, morton_codes, places_of_codes
from voxjax.ops.blocks.block_builder import blocks_of


def test_codes_and_places_are_each_others_inverse():
    places = np.random.default_rng(0).integers(0, 1 << 16, (500, 3))
    np.testing.assert_array_equal(places_of_codes(morton_codes(places)), places)
    children = np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]
    )
    assert morton_codes(children).tolist() == list(range(8))


@pytest.mark.parametrize("low", [(16, 8, 24), (13, 8, 31), (3, 5, 1), (-3, 0, 2)])
def test_nodes_of_eight_voxels_hold_what_the_map_holds(low):
    dense = random_boxes((40, 31, 26), seed=1)
    dense[:8] = 0
    low = np.array(low)
    found = np.zeros((80, 80, 80), np.uint8)
    blocks = blocks_of(dense)
    codes = key_block_codes(blocks, low)
    assert (np.diff(codes) > 0).all()
    for part in key_blocks(blocks, low, codes):
        mixed = iter(part.values)
        for place, is_level, level in zip(places_of_codes(part.code), part.is_level, part.level, strict=True):
            corner = tuple(slice(8 * n, 8 * n + 8) for n in place)
            if is_level:
                found[corner] = level
            else:
                cells = places_of_codes(np.arange(512))
                found[corner][tuple(cells.T)] = next(mixed)
    begin = np.maximum(low, 0)
    inside = dense[tuple(slice(b - l, None) for b, l in zip(begin, low, strict=True))]
    expected = np.zeros_like(found)
    expected[tuple(slice(b, b + n) for b, n in zip(begin, inside.shape, strict=True))] = inside
    np.testing.assert_array_equal(found, expected)
