"""Memory that registering maps takes, known before it begins."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from .._runtime.memory import GIGABYTE, check_memory, memory_limit
from .._runtime.tables import MAX_ROWS, check_cells
from ..grid import VoxelGrid
from ..maps.main_part import main_part


class MapSize(NamedTuple):
    """What the memory of a map depends on.

    Attributes:
        sides: Sides of the map's block [voxel].
        occupied: Number of occupied voxels.
        voxel_size: Voxel size of the map [m].
    """

    sides: tuple[int, ...]
    occupied: int
    voxel_size: float

    def at(self, voxel_size: float) -> tuple[float, float]:
        """Number of voxels and of occupied voxels at another voxel size [m]: the first a bound, the second about."""
        ratio = self.voxel_size / voxel_size
        # Occupied voxels are surfaces: in coarser maps they get fewer by the square; in finer ones they are split.
        return float(np.prod([side * ratio + 1 for side in self.sides])), self.occupied * ratio ** (
            2 if ratio < 1 else 3
        )


def check_register_memory(
    grids: Sequence[VoxelGrid], voxel_size: float, *, preset: Literal["default", "paper"] = "default"
) -> None:
    """Raise if there is not enough memory to register maps with each other, before the work begins.

    Costs a pass over each map, and a few more only where the estimate for uncropped maps does not fit.

    Args:
        grids: All maps that are kept at the same time; each pair of them is registered.
        voxel_size: Voxel size at which they are compared [m].
        preset: The method: the paper's counts in the window of each voxel of whole maps, which are not cropped for it.

    Raises:
        InputError: If a map has more voxels at that size than kernels can count, or all need more memory than there is
            (see `voxjax._runtime.memory.check_memory`).
    """
    _check_index_range(grids, voxel_size)
    # Without a known limit nothing is refused: a number that kernels cannot count is wrong on every machine.
    limit = memory_limit()
    if limit is None:
        return
    counts = [grid.num_occupied for grid in grids]
    sizes = [MapSize(grid.shape, n, grid.voxel_size) for grid, n in zip(grids, counts, strict=True)]
    uncropped = sizes if preset == "paper" else ()
    # The whole block bounds the box around what is known from above: where it fits, nobody needs to look for
    # the box.
    if register_memory(sizes, voxel_size, uncropped) <= limit:
        return
    # Features are of the box around what is known of the main part.
    sizes = [size._replace(sides=_known_sides(grid)) for grid, size in zip(grids, sizes, strict=True)]
    scaled = [size.at(voxel_size) for size in uncropped or sizes]
    check_memory(
        register_memory(sizes, voxel_size, uncropped),
        f"registering maps of together {sum(voxels for voxels, _ in scaled) / 1e6:,.3g} million voxels of "
        f"{voxel_size:g} m",
        f"take {_larger(sizes, uncropped, voxel_size, limit)}, crop the maps, or work tile by tile "
        "(voxjax.ops.map_tiles)",
    )


def _check_index_range(grids: Sequence[VoxelGrid], voxel_size: float) -> None:
    """Raise if the box around what a map knows has more voxels, or more occupied ones, than kernels can count.

    Maps whose whole block is small enough for both are not read.
    """
    for grid in grids:
        # There are no more occupied voxels than voxels, so one comparison is enough for both.
        if MapSize(grid.shape, 0, grid.voxel_size).at(voxel_size)[0] <= MAX_ROWS:
            continue
        part = MapSize(_known_sides(grid), grid.num_occupied, grid.voxel_size)
        num_voxels, num_occupied = part.at(voxel_size)
        advice = "take a larger voxel size, crop the map, or work tile by tile (voxjax.ops.map_tiles)"
        check_cells(num_voxels, num_occupied, f"a map at {voxel_size:g} m", advice)


def register_memory(sizes: Sequence[MapSize], voxel_size: float, uncropped: Sequence[MapSize] = ()) -> float:
    """Estimated peak beside the maps themselves and the running process [byte].

    Estimates were 1.0 to 1.8 times what a process that compiled all kernels grew by in one call
    (`python -m bench memory`): what needs half of the memory that is available is never refused.

    Args:
        sizes: Sizes of all maps whose features are kept.
        voxel_size: Voxel size at which they are compared [m].
        uncropped: Sizes of the maps whose window counts are taken, one map after the other; none in the default preset.
    """
    scaled = [size.at(voxel_size) for size in sizes]
    # While a map has pairs to come, its features hold states twice, nearest voxels and two codes for each voxel of the
    # box around what is known, and 14 numbers for each occupied one.
    kept = [8.0 * voxels + 60.0 * occupied for voxels, occupied in scaled]
    # The two maps of a pair take more while they are worked on; the largest two may be a pair.
    work = sorted(0.5 * voxels + 100.0 * occupied for voxels, occupied in scaled)
    # Compiled kernels of all stages, and what compiling them takes, whatever the maps.
    kernels = 0.75 * GIGABYTE
    # Which voxels are occupied, their counts (see `window_classes`), and their classes; gone before features are kept.
    window = max((6.0 * size.at(voxel_size)[0] for size in uncropped), default=0.0)
    return kernels + max(window, sum(kept) + sum(work[-2:]))


def _known_sides(grid: VoxelGrid) -> tuple[int, ...]:
    """Sides of the box around what is known of the main part of a map [voxel]."""
    states, sides = np.asarray(main_part(grid)[0].states), []
    for axis in range(3):
        hit = np.flatnonzero(states.any(axis=tuple(other for other in range(3) if other != axis)))
        sides.append(int(hit[-1] - hit[0]) + 1 if hit.size else 0)
    return tuple(sides)


def _larger(sizes: Sequence[MapSize], uncropped: Sequence[MapSize], voxel_size: float, limit: float) -> str:
    """A voxel size that fits, as advice."""
    for factor in (2, 4, 8):
        need = register_memory(sizes, factor * voxel_size, uncropped)
        if need <= limit:
            return f"a voxel size of {factor * voxel_size:g} m (about {need / GIGABYTE:.2g} GB)"
    return "a larger voxel size"
