"""Maps that lie in a store and are moved: what a window of the target needs of them is read, and no more.

Places are counted from the corner of the whole map, so that they are those of a map in memory, to the bit.
"""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float32, Int, Shaped

from ..blocks.block_builder import blocks_of
from ..blocks.words import BLOCK
from .block_lookup import MovedBlocks, check_target, images_of_middles
from .stored import Stored


class MovedStore:
    """A map in a store, and where its voxels lie in a target lattice.

    Attributes:
        stored: The map.
        affine: From voxels of the target to those of the map, see `rigid.source_from_target`.
        shape: Number of voxels of the map along x, y, z.
    """

    def __init__(self, stored: Stored, affine: Float32[np.ndarray, "3 4"]) -> None:
        """Nothing is read yet.

        Raises:
            InputError: If the box is too large, see `block_lookup.check_target`.
        """
        check_target(stored.shape, "a map that is moved", "crop it to its known part")
        self.stored, self.affine, self.shape = stored, affine, stored.shape

    @property
    def num_arrays(self) -> int:
        """How many values a voxel has."""
        return self.stored.num_arrays

    @property
    def num_bytes(self) -> int:
        """Memory that the map takes [byte]: none, but for what of it was read last."""
        return 0

    def parts(self, number: int) -> Iterator[tuple[Int[np.ndarray, "m 3"], Shaped[np.ndarray, "m 8 8 8"]]]:
        """Blocks of one of the arrays that are not all 0, in lexicographic order: their places, and their values."""
        return self.stored.parts(number)

    def holds_any(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> bool:
        """Whether the map may hold anything in a window of target blocks, from block `low` up to and without `high`."""
        first, last = self._reach(low, high)
        if (last <= first).any():
            return False
        cubes = tuple(map(slice, first // self.stored.side, -(-last // self.stored.side)))
        return bool(self.stored.cubes[cubes].any())

    def near(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> MovedBlocks | None:
        """The part of the map that a window of target blocks meets, read; None where it meets none of the box."""
        first, last = self._reach(low, high)
        if (last <= first).any():
            return None
        values = self.stored.read(tuple(first.tolist()), tuple(last.tolist()))
        arrays = tuple(blocks_of(each) for each in values)
        return MovedBlocks(arrays, self.affine, first=first // BLOCK, shape=self.stored.shape)

    def _reach(
        self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]
    ) -> tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]:
        """Lowest voxel, of a block's corner, and one past the highest that the blocks of a window may look up."""
        images = [images_of_middles(self.affine, axis, low, high) for axis in range(3)]
        first = np.asarray([np.floor(sum(v.min() for v in image)) - 1 for image in images]).astype(np.int64)
        last = np.asarray([np.floor(sum(v.max() for v in image)) + 2 for image in images]).astype(np.int64)
        return np.maximum(BLOCK * first, 0), np.minimum(BLOCK * last, self.stored.shape)
