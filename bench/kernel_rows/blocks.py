"""Rows of the sparse and the tiled path: cost at constant surface, the break-even with the dense count, tiles."""

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from bench.kernel_row import KernelRow, Target
from voxjax._types import Array
from voxjax.ops.blocks.choice import MAX_BLOCK_SHARE, MIN_VOXELS, box_count_at
from voxjax.ops.blocks.counts import count_in_blocks, list_blocks
from voxjax.ops.blocks.words import BLOCK, occupied_blocks, pack_words
from voxjax.ops.large.tiles import map_tiles
from voxjax.ops.window.classes import box_count

SURFACE_BOX = (256, 256, 128)
"""All surface of the rows of constant surface lies in a box of this shape [voxel]; the grid around it grows."""

_COUNT = functools.partial(box_count, size=7)


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module; with `quick`, grids of at most 256 x 256 x 256 voxels."""
    shapes = [SURFACE_BOX, (256, 256, 256), (512, 512, 256), (512, 512, 512)][: 2 if quick else 4]
    yield _growth(SURFACE_BOX, shapes[-1])
    for shape in shapes:
        yield _constant_surface(shape)
    for share in (0.02, 0.1, 0.2, 0.4):
        yield _break_even(128 if quick else 256, share)
    yield _tiles(128 if quick else 512, 64 if quick else 256)


def surface(shape: tuple[int, int, int]) -> np.ndarray:
    """Three floors and six walls, a tenth of it missing, in the low corner of an otherwise empty grid; bool."""
    box = np.zeros(SURFACE_BOX, bool)
    for z in (5, 50, 100):
        box[5:250, 5:250, z] = True
    for at in (5, 120, 248):
        box[at, 5:250, 5:100] = box[5:250, at, 5:100] = True
    box &= np.random.default_rng(0).random(SURFACE_BOX) < 0.9
    grid = np.zeros(shape, bool)
    grid[tuple(slice(side) for side in SURFACE_BOX)] = box
    return grid


def _name(shape: tuple[int, ...]) -> str:
    """Shape as it stands in the names of rows."""
    return "x".join(map(str, shape))


def _in_blocks(words: Array) -> jax.Array:
    """Counts of all occupied blocks, from packed bits on the device to the blocked result."""
    return count_in_blocks(list_blocks(words, halo=3), size=7)


def _check_blocks(words: Array, counts: jax.Array) -> int:
    """Number of blocks, after comparing each of them with the dense counts."""
    blocks = list_blocks(words, halo=3)
    ours, number = np.asarray(count_in_blocks(blocks, size=7)), int(blocks.num_found)
    pads = [(0, -side % BLOCK) for side in counts.shape]
    dense = np.pad(np.asarray(counts), pads)
    for block, index in zip(ours[:number], np.asarray(blocks.index), strict=False):
        low = BLOCK * index
        np.testing.assert_array_equal(block, dense[tuple(slice(n, n + BLOCK) for n in low)])
    return number


def _growth(small: tuple[int, int, int], large: tuple[int, int, int]) -> KernelRow:
    """Counts of one surface, in a small grid and in a large one."""
    grids = {_name(shape): jax.device_put(pack_words(surface(shape))) for shape in (small, large)}
    counts = [np.asarray(_in_blocks(words)) for words in grids.values()]
    assert int(counts[0].sum()) == int(counts[1].sum()) > 0
    ours, reference = _name(large), _name(small)
    growth = int(np.prod(large) / np.prod(small))
    return KernelRow(
        name=f"box_count 7 in blocks, volume x {growth} at constant surface",
        ours=ours,
        candidates={name: functools.partial(_in_blocks, words) for name, words in grids.items()},
        count=int(surface(small).sum()),
        unit="occupied voxel",
        targets=(Target(reference, 0.5),),
        note=f"from packed bits on the device; {reference} against {ours}: at most twice the time",
    )


def _constant_surface(shape: tuple[int, int, int]) -> KernelRow:
    """Blocks against the dense count, in a grid of one shape."""
    host = surface(shape)
    occupied = jax.device_put(host)
    words = pack_words(occupied)
    number = _check_blocks(words, box_count(occupied, size=7))
    share = number / occupied_blocks(words).size
    return KernelRow(
        name=f"box_count 7 at constant surface, {_name(shape)}",
        ours="blocks",
        candidates={
            "blocks": lambda: _in_blocks(words),
            "blocks, packing included": lambda: _in_blocks(jnp.asarray(pack_words(occupied))),
            "dense": lambda: box_count(occupied, size=7),
        },
        count=int(host.sum()),
        unit="occupied voxel",
        # Up to a tenth of the blocks, counts in blocks from packed bits must not lose to the dense count.
        targets=(Target("dense", 1.0),) if share <= 0.1 else (),
        note=f"{number} occupied blocks, {100 * share:.1f} % of all; the result stays in blocks",
    )


def _break_even(side: int, share: float) -> KernelRow:
    """Counts at the occupied voxels, both ways and as chosen, with occupied blocks spread at random."""
    rng = np.random.default_rng(0)
    is_block = rng.random((side // BLOCK,) * 3) < share
    host = is_block.repeat(BLOCK, 0).repeat(BLOCK, 1).repeat(BLOCK, 2) & (rng.random((side,) * 3) < 0.12)
    occupied = jax.device_put(host)
    index = jax.device_put(np.argwhere(host).astype(np.int32))
    ways = {"automatic": None, "dense": "dense", "blocks": "blocks"}
    candidates = {
        name: functools.partial(box_count_at, occupied, index, size=7, implementation=way)
        for name, way in ways.items()
    }
    dense = np.asarray(candidates["dense"]())
    for call in candidates.values():
        np.testing.assert_array_equal(np.asarray(call()), dense)
    chosen = "blocks" if is_block.mean() <= MAX_BLOCK_SHARE and host.size >= MIN_VOXELS else "dense"
    return KernelRow(
        name=f"box_count 7 at occupied voxels, {side}^3, {100 * share:.0f} % of blocks",
        ours="automatic",
        candidates=candidates,
        count=len(dense),
        unit="occupied voxel",
        # Where the two ways are level, the choice may take the slower one.
        targets=(Target("dense", 0.8), Target("blocks", 0.8)),
        note=f"from bool on the device, packing included; chosen: {chosen}",
    )


def _tiles(side: int, tile: int) -> KernelRow:
    """Tile by tile against the whole grid, both from and to host memory."""
    host = np.random.default_rng(0).random((side,) * 3, np.float32) < 0.03
    target = np.zeros(host.shape, np.uint16)

    def tiled() -> np.ndarray:
        map_tiles(_COUNT, host, target, halo=3, tile=tile)
        return target

    np.testing.assert_array_equal(tiled(), np.asarray(_COUNT(host)))
    return KernelRow(
        name=f"box_count 7 by tiles, {side}^3",
        ours="tiles",
        candidates={"tiles": tiled, "whole": lambda: np.asarray(_COUNT(host))},
        count=side**3,
        unit="voxel",
        bytes_moved=3.0 * side**3,
        note=f"tiles of {tile}^3 with a halo of 3, host to host; the device holds two tiles",
    )
