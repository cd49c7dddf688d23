"""Memory that registering maps takes, known before it begins."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from .._runtime.memory import GIGABYTE, check_memory, memory_limit
from .._runtime.tables import MAX_ROWS, check_pool
from .._runtime.threads import num_cores
from ..grid import VoxelGrid
from ..maps.main_part import main_part
from ..maps.prepared import FIELD_RADIUS
from ..ops.blocks.block_array import BLOCK_VOXELS
from ..ops.blocks.windows import TILE
from ..ops.blocks.words import BLOCK
from ..ops.evidence.map_tables import blocks_near
from ..ops.evidence.translations import BATCH_BYTES
from ..registration.hypotheses.exhaustive import affordable_coarsening
from ..registration.hypotheses.settings import ExhaustiveConfig


class MapSize(NamedTuple):
    """What the memory of a map depends on.

    Attributes:
        sides: Sides of the map's box [voxel].
        occupied: Number of occupied voxels.
        voxel_size: Voxel size of the map [m].
        blocks: Blocks of 8 x 8 x 8 voxels near something occupied, or with voxels of different states; None for all of
            the box, which is their number at most.
        is_dense: Whether the map is kept as an array of all voxels of the box.
    """

    sides: tuple[int, ...]
    occupied: int
    voxel_size: float
    blocks: int | None = None
    is_dense: bool = True

    def at(self, voxel_size: float) -> "Need":
        """What the map has at another voxel size [m]: a bound, but of occupied voxels and blocks about as many."""
        ratio = self.voxel_size / voxel_size
        # Surfaces have fewer voxels, and fewer blocks, in coarser maps by the square; in finer ones voxels are split.
        growth = ratio ** (2 if ratio < 1 else 3)
        sides = [side * ratio + 1 for side in self.sides]
        in_box = math.prod(side / BLOCK + 1 for side in sides)
        blocks = in_box if self.blocks is None else min(self.blocks * growth, in_box)
        return Need(math.prod(sides), in_box, blocks, self.occupied * growth, self.is_dense)


class Need(NamedTuple):
    """What a map has at a voxel size.

    Attributes:
        voxels: Voxels of the box.
        in_box: Blocks of the box.
        blocks: Blocks that are kept.
        occupied: Occupied voxels.
        is_dense: Whether the voxels of the box are kept as an array.
    """

    voxels: float
    in_box: float
    blocks: float
    occupied: float
    is_dense: bool

    @property
    def kept(self) -> float:
        """Memory of the map's features while it has pairs to come [byte]."""
        # Blocks are held by the map, and in the pools of nearest voxels, states and two codes; a table says where each
        # is, once for the map and once for the pools.
        of_block = BLOCK_VOXELS * (1 + 4 + 1 + 1 + 1)
        box = self.voxels if self.is_dense else 0.0
        return box + of_block * self.blocks + 8 * self.in_box + 60 * self.occupied

    @property
    def work(self) -> float:
        """What the map takes beside its features while a pair is worked on [byte]."""
        # Nearest voxels are made in a dense tile.
        return 4.5 * min(self.voxels, TILE) + 100 * self.occupied


def check_register_memory(
    grids: Sequence[VoxelGrid], voxel_size: float, *, preset: Literal["default", "paper"] = "default"
) -> None:
    """Raise if there is not enough memory to register maps with each other, before the work begins.

    Costs a pass over each map, and a few more only where the estimate for whole boxes does not fit.

    Args:
        grids: All maps that are kept at the same time; each pair of them is registered.
        voxel_size: Voxel size at which they are compared [m].
        preset: The method: the paper's counts in the window of each voxel of whole maps, which are not cropped for it.

    Raises:
        InputError: If a map has more blocks or occupied voxels at that size than kernels can count, or all need more
            memory than there is (see `voxjax._runtime.memory.check_memory`).
    """
    # Without a known limit nothing is refused: a number that kernels cannot count is wrong on every machine.
    limit = memory_limit()
    sizes = [MapSize(grid.shape, grid.num_occupied, grid.voxel_size) for grid in grids]
    uncropped = sizes if preset == "paper" else ()
    fits = limit is None or register_memory(sizes, voxel_size, uncropped) <= limit
    # The whole box bounds what is in it from above: where it fits, nobody needs to look.
    if fits and all(_is_countable(size.at(voxel_size)) for size in sizes):
        return
    # Features are of what is known of the main part.
    sizes = [content_size(grid) for grid in grids]
    for need in (size.at(voxel_size) for size in sizes):
        check_pool(need.in_box, need.blocks, need.occupied, f"a map at {voxel_size:g} m")
    if limit is None:
        return
    scaled = [size.at(voxel_size) for size in sizes]
    num_voxels = BLOCK_VOXELS * sum(need.blocks for need in scaled)
    if uncropped:
        num_voxels = sum(size.at(voxel_size).voxels for size in uncropped)
    check_memory(
        register_memory(sizes, voxel_size, uncropped),
        f"registering maps of together {num_voxels / 1e6:,.3g} million voxels of {voxel_size:g} m",
        f"take {_larger(sizes, uncropped, voxel_size, limit)}, crop the maps, or work tile by tile "
        "(voxjax.ops.map_tiles)",
    )


def register_memory(sizes: Sequence[MapSize], voxel_size: float, uncropped: Sequence[MapSize] = ()) -> float:
    """Estimated peak beside the maps themselves and the running process [byte].

    Estimates were 1.0 to 2.5 times what a process that compiled all kernels grew by in one call (`python -m bench
    memory`): least for maps of different places, for which all sources compile theirs.

    Args:
        sizes: Sizes of all maps whose features are kept.
        voxel_size: Voxel size at which they are compared [m].
        uncropped: Sizes of the maps whose window counts are taken, one map after the other; none in the default preset.
    """
    scaled = [size.at(voxel_size) for size in sizes]
    # The two maps of a pair take more while they are worked on; the largest two may be a pair.
    work = sorted(need.work for need in scaled)
    searched = _in_coarser_copies(sizes, voxel_size)
    # Compiled kernels of all stages, and what compiling them takes, whatever the maps.
    kernels = GIGABYTE
    # Which voxels are occupied, their counts (see `window_classes`), and their classes; gone before features are kept.
    window = max((6.0 * size.at(voxel_size).voxels for size in uncropped), default=0.0)
    # The mirror image of a map is held beside it, in blocks, and only once the work is done (`pipeline/causes.py`).
    images = () if uncropped else (need._replace(is_dense=False).kept for need in scaled)
    mirrored = max(images, default=0.0)
    return kernels + max(window, sum(need.kept for need in scaled) + max(sum(work[-2:]), mirrored) + searched)


def _in_coarser_copies(sizes: Sequence[MapSize], voxel_size: float) -> float:
    """What the copies of wide maps and the search in them take [byte]; 0 where no pair is that wide."""
    if len(sizes) < 2:
        return 0.0
    # Boxes in frames of their own lie at any angle to each other: the longest sides count together.
    sides = sorted((np.sort(size.sides) * size.voxel_size for size in sizes), key=np.prod)[-2:]
    settings = ExhaustiveConfig()
    factor = affordable_coarsening((sides[0] + sides[1]) / voxel_size, settings)
    if factor == 1:
        return 0.0
    copies = sum(size.at(factor * voxel_size).kept for size in sizes)
    # A map that lies askew in its block fills it up to three times.
    cells = 3 * settings.most_cells
    # A batch of transforms, eight bytes a cell; and of those at work the spectrum of the scores, the scores, and what
    # they are made of.
    transforms = BATCH_BYTES + 16.0 * cells * min(num_cores(), max(BATCH_BYTES // (8 * cells), 1))
    return copies + transforms


def _is_countable(need: Need) -> bool:
    """Whether a box has so few voxels that kernels count whatever may be in it."""
    return need.voxels <= MAX_ROWS


def content_size(grid: VoxelGrid) -> MapSize:
    """Size of what is known of the main part of a map, by its blocks."""
    part = main_part(grid)[0].crop_to_known()
    index, states = part.occupied_index(), part.state_blocks()
    near = blocks_near(index, states.table.shape, radius=FIELD_RADIUS)
    # Far from anything occupied, blocks share the rows of the states, of which the first is that of the unknown.
    blocks = len(near) + len(states.pool) - 1
    return MapSize(part.shape, len(index), grid.voxel_size, blocks, is_dense=not grid.is_sparse)


def _larger(sizes: Sequence[MapSize], uncropped: Sequence[MapSize], voxel_size: float, limit: float) -> str:
    """A voxel size that fits, as advice."""
    for factor in (2, 4, 8):
        need = register_memory(sizes, factor * voxel_size, uncropped)
        if need <= limit:
            return f"a voxel size of {factor * voxel_size:g} m (about {need / GIGABYTE:.2g} GB)"
    return "a larger voxel size"
