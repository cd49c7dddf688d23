"""Backward lookup of nearest voxels in blocks: what a moved map holds in blocks of 8 x 8 x 8 voxels of a target.

A block of the target, moved back, lies within the 3 x 3 x 3 blocks of the source around the one that holds the image of
its middle: no centre of its voxels is farther from there than 3.5 sqrt(3) = 6.1 source voxels, and the blocks around
reach 8. So a table that is a border wider than the source's says of each target block, by one read, whether all is 0 in
it (`EMPTY`), whether one other value fills it (`LEVEL`), or whether its voxels have to be looked up one by one
(`MIXED`). Each of these takes two reads: which of the 27 blocks it is in, and what that holds there. Source voxels must
be as large as the target's at least.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32, Shaped, UInt8

from ..._checks import InputError
from ..._runtime.buckets import wide_bucket_size
from ..._runtime.tables import reserve
from ..._types import Array
from ..blocks.block_array import BLOCK_VOXELS, BlockArray, lattice_shape
from ..blocks.words import BLOCK
from .interpolate import TIE, is_within

EMPTY, LEVEL, MIXED = np.uint8(0), np.uint8(1), np.uint8(2)
"""What a block of the target holds: nothing known, one value throughout, or what has to be looked up."""

OUTSIDE, PARTLY, INSIDE = np.uint8(0), np.uint8(1), np.uint8(3)
"""Where it lies of the box of the source; the bits of three axes are joined by `&`."""


class Survey(NamedTuple):
    """What one source holds in the blocks of a window of the target, each array (u, v, w).

    Attributes:
        kind: `EMPTY`, `LEVEL` or `MIXED`.
        cover: `OUTSIDE`, `PARTLY` or `INSIDE` of the source's box.
    """

    kind: UInt8[np.ndarray, "u v w"]
    cover: UInt8[np.ndarray, "u v w"]


class MovedBlocks:
    """A map in blocks, or a part of one, and where its voxels lie in a target lattice."""

    def __init__(
        self,
        arrays: tuple[BlockArray, ...],
        affine: Float32[np.ndarray, "3 4"],
        *,
        first: Int[np.ndarray, "3"] | None = None,
        shape: tuple[int, int, int] | None = None,
    ) -> None:
        """Look through the tables once.

        Args:
            arrays: Values of one box, which is empty where all are 0.
            affine: From voxels of the target to those of the map, see `rigid.source_from_target`.
            first: Block of the map at which the arrays begin, if they are a part of it that windows do not leave.
            shape: Number of voxels of the whole map along x, y, z; None if the arrays are the whole.

        Raises:
            InputError: If the map's box is too large, see `check_target`.
        """
        self.arrays, self.affine = arrays, affine
        self.first = np.zeros(3, np.int64) if first is None else first
        self.shape = arrays[0].shape if shape is None else shape
        check_target(self.shape, "a map that is moved", "crop it to its known part")
        self._kinds = _kinds(arrays)
        begun = zip(self.shape, self.first.tolist(), arrays[0].table.shape, strict=True)
        self._covers = [_covers(side, start, count) for side, start, count in begun]

    def near(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> "MovedBlocks | None":
        """The part of the map that a window of target blocks meets: all of it is there."""
        return self

    @property
    def num_arrays(self) -> int:
        """How many values a voxel has."""
        return len(self.arrays)

    @property
    def num_bytes(self) -> int:
        """Memory that the map takes [byte]."""
        return sum(array.num_bytes for array in self.arrays)

    def parts(self, number: int) -> Iterator[tuple[Int[np.ndarray, "m 3"], Shaped[np.ndarray, "m 8 8 8"]]]:
        """Blocks of one of the arrays that are not all 0, in lexicographic order: their places, and their values."""
        return self.arrays[number].parts()

    def holds_any(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> bool:
        """Whether the map may hold anything in a window of target blocks, from block `low` up to and without `high`."""
        images = [self._images(axis, low, high) for axis in range(3)]
        # The box around the images of all middles, which for a turned map is wider than what they fill.
        first = [max(int(np.floor(sum(v.min() for v in image))), 0) for image in images]
        last = [int(np.floor(sum(v.max() for v in image))) for image in images]
        box = tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))
        return min(last) >= 0 and bool(self._kinds[box].any())

    def survey(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> Survey:
        """What the map holds in a window of target blocks.

        Args:
            low: Lowest block of the window.
            high: One past its highest.
        """
        at = []
        for axis in range(3):
            x, y, z = self._images(axis, low, high)
            image = x[:, None, None] + y[:, None] + z
            at.append(np.clip(image, 0, self._kinds.shape[axis] - 1).astype(np.int32))
        cover = self._covers[0][at[0]] & self._covers[1][at[1]] & self._covers[2][at[2]]
        return Survey(self._kinds[tuple(at)], cover)

    def _images(
        self, axis: int, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]
    ) -> list[Float64[np.ndarray, " n"]]:
        """Like `images_of_middles`, in the table of kinds, which begins two blocks before the arrays."""
        x, y, z = images_of_middles(self.affine, axis, low, high)
        return [x + (2.0 - self.first[axis]), y, z]

    def middles(self, places: Int[np.ndarray, "m 3"]) -> tuple[Shaped[np.ndarray, " m"], ...]:
        """Values in the middle of target blocks, of each array; 0 beyond the box."""
        at = self._middle_blocks(places) - self.first
        is_inside = np.all((at >= 0) & (at < self.arrays[0].table.shape), axis=1)
        at = np.where(is_inside[:, None], at, 0)
        found = []
        for array in self.arrays:
            row = np.where(is_inside, np.asarray(array.table)[tuple(at.T)], 0)
            found.append(np.asarray(array.pool)[row, 0, 0, 0])
        return tuple(found)

    def look_up(self, places: Int[np.ndarray, "m 3"]) -> Callable[[slice, int], tuple[jax.Array, ...]]:
        """Get ready to look up the voxels of target blocks: what the map has around them goes to the device.

        Args:
            places: Blocks of the target.

        Returns:
            A function of a run of `places` and of the length up to which it is padded, which gives the values of each
            array, (length, 512) on the device.
        """
        corner = self._middle_blocks(places) - 1
        gathered = [_around(array, corner - self.first) for array in self.arrays]
        first, start = (BLOCK * corner).astype(np.int32), (BLOCK * places).astype(np.int32)

        def run(part: slice, length: int) -> tuple[jax.Array, ...]:
            where = [padded(values[part], length) for values in (first, start)]
            return tuple(
                look_up_voxels(pool, padded(rows[part], length), *where, self.affine)
                for pool, rows in gathered
            )

        return run

    def covered(self, places: Int[np.ndarray, "m 3"], length: int) -> jax.Array:
        """Whether the centres of the voxels of target blocks lie in the map's box, bool (length, 512)."""
        start = padded((BLOCK * places).astype(np.int32), length)
        return voxels_inside(np.asarray(self.shape, np.int32), start, self.affine)

    def _middle_blocks(self, places: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 3"]:
        """Blocks of the map that hold the images of the middles of target blocks."""
        m = self.affine.astype(np.float64)
        return np.floor((np.asarray(places) + 0.5) @ m[:, :3].T + m[:, 3] / BLOCK).astype(np.int64)


def images_of_middles(
    affine: Float32[np.ndarray, "3 4"], axis: int, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]
) -> list[Float64[np.ndarray, " n"]]:
    """Where the middles of the target blocks of a window come to lie in the source [block], as the sum of three.

    Args:
        affine: From voxels of the target to those of the source.
        axis: Of the source.
        low: Lowest block of the window.
        high: One past its highest.
    """
    m = affine[axis].astype(np.float64)
    x, y, z = (m[k] * (np.arange(low[k], high[k]) + 0.5) for k in range(3))
    return [x + m[3] / BLOCK, y, z]


def padded(values: Shaped[np.ndarray, "m *rest"], length: int) -> Shaped[np.ndarray, "n *rest"]:
    """The rows, and the last of them again up to a length."""
    if len(values) == length:
        return values
    return values[np.minimum(np.arange(length), len(values) - 1)]


def runs(count: int) -> Iterator[tuple[slice, int]]:
    """Runs in which so many blocks are looked up, and the few lengths up to which they are padded."""
    largest, smallest = 1 << 10, 1 << 6
    for start in range(0, count, largest):
        part = slice(start, min(start + largest, count))
        yield part, wide_bucket_size(part.stop - part.start, smallest)


def check_target(shape: tuple[int, int, int], what: str, advice: str) -> None:
    """Raise if a box is too large for lookups in blocks, as their source or target.

    Raises:
        InputError: If it has more blocks than int32 counts, or float32 does not place the voxels at its ends.
    """
    # Four numbers of such a size are added, each rounded to a quarter at most: the 27 blocks reach two voxels farther
    # than needed.
    longest, most = 1 << 22, (1 << 31) - 1
    a, b, c = lattice_shape(shape)
    if max(shape) > longest or a * b * c > most:
        size = " x ".join(f"{side:,}" if side < 1e12 else f"{side:.3g}" for side in shape)
        raise InputError(
            f"{what} must have at most {longest:,} voxels along an axis and {most:,} blocks of 8 x 8 x 8, got {size} "
            f"voxels; {advice}."
        )


def _places(
    start: Int32[Array, "m 3"], source_from_target: Float32[Array, "3 4"]
) -> list[Int32[Array, "m 512"]]:
    """Source voxels along x, y, z that hold the centres of the voxels of target blocks."""
    cell = jnp.arange(BLOCK_VOXELS, dtype=jnp.int32)[None]
    steps = cell >> 6, (cell >> 3) & 7, cell & 7
    centre = [(start[:, a, None] + steps[a]).astype(jnp.float32) + jnp.float32(0.5) for a in range(3)]
    m = source_from_target
    # Written out by rows: a matrix product may run in a lower precision on some devices.
    coordinates = [
        m[a, 0] * centre[0] + m[a, 1] * centre[1] + m[a, 2] * centre[2] + m[a, 3] for a in range(3)
    ]
    return [jnp.floor(axis + TIE).astype(jnp.int32) for axis in coordinates]


@jax.jit
def look_up_voxels(
    pool: Shaped[Array, "r 512"],
    rows: Int32[Array, "m 27"],
    first: Int32[Array, "m 3"],
    start: Int32[Array, "m 3"],
    source_from_target: Float32[Array, "3 4"],
) -> Shaped[Array, "m 512"]:
    """Values of the nearest source voxels for the voxels of target blocks.

    Args:
        pool: Blocks of the source.
        rows: Rows in it of the 3 x 3 x 3 source blocks around the middle of each target block, in C order.
        first: Lowest voxel of the first of these.
        start: Lowest voxel of each target block.
        source_from_target: Affine map (3, 4) that the function of that name gives.
    """
    i, j, k = (axis - first[:, a, None] for a, axis in enumerate(_places(start, source_from_target)))
    which = ((i >> 3) * 3 + (j >> 3)) * 3 + (k >> 3)
    cell = ((i & 7) << 6) | ((j & 7) << 3) | (k & 7)
    # The module says why no place lies beyond the 27 blocks; checked again here, each would cost a comparison.
    flat = 27 * jnp.arange(len(rows), dtype=jnp.int32)[:, None] + which
    row = jnp.asarray(rows).reshape(-1).at[flat].get(mode="promise_in_bounds")
    return jnp.asarray(pool).reshape(-1).at[BLOCK_VOXELS * row + cell].get(mode="promise_in_bounds")


@jax.jit
def voxels_inside(
    source_shape: Int32[Array, "3"], start: Int32[Array, "m 3"], source_from_target: Float32[Array, "3 4"]
) -> Bool[Array, "m 512"]:
    """Whether the centres of the voxels of target blocks lie in the source's box; arguments as `look_up_voxels`."""
    i, j, k = _places(start, source_from_target)
    return is_within(i, source_shape[0]) & is_within(j, source_shape[1]) & is_within(k, source_shape[2])


def _around(array: BlockArray, corner: Int[np.ndarray, "m 3"]) -> tuple[jax.Array, Int32[np.ndarray, "m 27"]]:
    """The blocks of an array that are met by 3 x 3 x 3 blocks from each corner on, each once, and where they are."""
    table, pool = np.asarray(array.table), np.asarray(array.pool)
    flat, is_inside = np.zeros((len(corner), 1, 1, 1), np.int64), np.ones((len(corner), 1, 1, 1), bool)
    for axis, side in enumerate(table.shape):
        along = corner[:, axis, None] + np.arange(3)
        shape = [len(corner), *(3 if other == axis else 1 for other in range(3))]
        is_inside = is_inside & ((along >= 0) & (along < side)).reshape(shape)
        flat = flat * side + np.clip(along, 0, side - 1).reshape(shape)
    rows = np.where(is_inside, table.reshape(-1)[flat], 0).reshape(-1, 27)
    # Row 0 stays row 0: where nothing is, the kernel reads one block alone.
    is_used = np.zeros(len(pool), bool)
    is_used[rows] = True
    is_used[0] = True
    used = np.flatnonzero(is_used)
    number = np.zeros(len(pool), np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    # Pools of few lengths share a program.
    blocks = np.zeros((wide_bucket_size(len(used), 1 << 10), BLOCK_VOXELS), pool.dtype)
    blocks[: len(used)] = pool[used].reshape(-1, BLOCK_VOXELS)
    return jnp.asarray(blocks), number[rows]


def _kinds(arrays: tuple[BlockArray, ...]) -> UInt8[np.ndarray, "a b c"]:
    """Kind of a target block by the source block that holds the image of its middle, with a border of two blocks."""
    sides = np.asarray(arrays[0].table.shape)
    kinds = reserve(int(np.prod(sides + 4)), dtype=np.uint8).reshape(sides + 4)
    # A few layers at a time, so that what they are made of stays small.
    step = max((1 << 20) // int(np.prod(sides[1:] + 4)), 1)
    for start in range(0, int(sides[0]) + 2, step):
        stop = min(start + step, int(sides[0]) + 2)
        if not any(np.asarray(array.table)[max(start - 2, 0) : stop].any() for array in arrays):
            continue
        is_known, is_level = np.zeros(1, bool), np.ones(1, bool)
        for array in arrays:
            lowest, highest = _extremes(np.asarray(array.table), start, stop)
            is_known = is_known | (highest != 0)
            is_level = is_level & (lowest == highest) & array.is_uniform[highest]
        found = np.where(is_known, np.where(is_level, LEVEL, MIXED), EMPTY)
        kinds[start + 1 : stop + 1, 1:-1, 1:-1] = found
    return kinds


def _extremes(table: Int32[np.ndarray, "a b c"], start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest of the 3 x 3 x 3 entries around each, with a border of one, in layers of what that gives."""
    first, last = max(start - 2, 0), min(stop, table.shape[0])
    part = np.zeros((stop - start + 2, table.shape[1] + 4, table.shape[2] + 4), np.int32)
    part[first - start + 2 : last - start + 2, 2:-2, 2:-2] = table[first:last]
    found = []
    for choose in (np.minimum, np.maximum):
        values = part
        for axis in range(3):
            count = values.shape[axis] - 2
            before, here, after = (values[(slice(None),) * axis + (slice(k, k + count),)] for k in range(3))
            values = choose(choose(before, here), after)
        found.append(values)
    return found[0], found[1]


def _covers(side: int, first: int, count: int) -> UInt8[np.ndarray, " n"]:
    """Where the three blocks around each block along an axis lie of the box, with a border of two blocks.

    Args:
        side: Of the box [voxel].
        first: Block at which the table begins.
        count: How many it has.
    """
    block = np.arange(first - 2, first + count + 2)
    low, high = BLOCK * (block - 1), BLOCK * (block + 2)
    is_outside = (high <= 0) | (low >= side)
    return np.where(is_outside, OUTSIDE, np.where((low >= 0) & (high <= side), INSIDE, PARTLY))
