"""Values of a box that lie elsewhere, in cubes that are read as they are needed."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int, Shaped

from ..blocks.block_array import lattice_shape
from ..blocks.block_builder import split
from ..blocks.words import BLOCK

Window = tuple[Shaped[np.ndarray, "x y z"], ...]


class Stored(NamedTuple):
    """Values of a box that are read as they are needed.

    Attributes:
        shape: Number of voxels along x, y, z.
        cubes: Which cubes of the box may hold something that is not 0.
        side: Sides of the cubes [voxel], whole blocks.
        read: Gives the values from one voxel up to and without another, both inside the box; states come first.
        num_arrays: How many values a voxel has.
    """

    shape: tuple[int, int, int]
    cubes: Bool[np.ndarray, "a b c"]
    side: int
    read: Callable[[tuple[int, ...], tuple[int, ...]], Window]
    num_arrays: int

    def parts(self, number: int) -> Iterator[tuple[Int[np.ndarray, "m 3"], Shaped[np.ndarray, "m 8 8 8"]]]:
        """Blocks that are not all 0, in lexicographic order, layer by layer: their places, and their values.

        Args:
            number: Which of the values that are read.
        """
        for layer in range(lattice_shape(self.shape)[0]):
            low, high = (BLOCK * layer, 0, 0), (min(BLOCK * (layer + 1), self.shape[0]), *self.shape[1:])
            index, blocks = split(self.read(low, high)[number])
            yield index + np.asarray([layer, 0, 0]), blocks
