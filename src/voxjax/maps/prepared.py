"""`PreparedMap`: everything about one map that registration needs, computed once and used for all its pairs."""

import math
from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float32, Int, Int32, UInt8, UInt32

from .._runtime.placement import to_device
from .._runtime.tables import as_table, pool_lengths
from .._types import Array
from ..grid import VoxelGrid, check_resolution
from ..ops.blocks.block_array import BLOCK_VOXELS, lattice_shape
from ..ops.blocks.words import BLOCK
from ..ops.evidence.lookup import Block
from ..ops.evidence.map_tables import code_pool, map_pools
from ..ops.surface.moments import SurfaceMoments, tiled_moments

FIELD_RADIUS = 5
"""Reach of the nearest-voxel field [voxel]: what refinement can pull in."""

COARSE_FACTOR = 2
"""Width of a coarse cell [voxel], at whose tolerance unrefined poses are judged. With cells of three, large maps of
coarse voxels agree with each other everywhere, and the right pose drowns."""


class PreparedMap(eqx.Module):
    """One map, ready to be registered with any other of the same working voxel size.

    Attributes:
        grid: The map at the working voxel size, cut to what is known.
        points: Occupied voxel centres [m], followed by zeros, as all lists and flat fields: their lengths are few
            (`_runtime.tables`), so that maps share compiled kernels.
        anchors: Voxel centres moved onto the planes through their neighbourhoods [m], which takes out most of what
            the grid rounded; voxel centres where there is no plane.
        normals: Unit normals, toward free space where the map has any.
        sides: Normals where they say which side is free, rows of zero elsewhere.
        weights: Leverage of each voxel: how much it rules out; sums to 1, 0 for padding. Floors and ceilings together
            weigh as much as the walls along one axis, whatever their areas.
        planarity: In [0, 1], 0 for padding.
        num_points: Number of rows that are not padding.
        free_share: Share of the occupied voxels with free space on one side of them.
        table: Row of the pools of each block of 8 x 8 x 8 voxels of the map, in C order: blocks far from anything
            occupied share rows.
        keys: Pool of the nearest occupied voxel of each voxel; flat, 512 cells a row, as all pools.
        codes: Pool of evidence codes at the tolerance of the voxel size.
        rough_codes: Pool of evidence codes at the tolerance of cells `COARSE_FACTOR` voxels wide.
        states: Pool of the states.
        num_rows: Rows of the pools that are not padding.
        num_shared: The first rows, which blocks may share; the others stand for one block each, in C order.
        dims: Size of the map [voxel].
        centroid: Mean of the occupied voxel centres [m], float32 (3,).
    """

    grid: VoxelGrid
    points: Float32[Array, "n 3"]
    anchors: Float32[Array, "n 3"]
    normals: Float32[Array, "n 3"]
    sides: Float32[Array, "n 3"]
    weights: Float32[Array, "n"]
    planarity: Float32[Array, "n"]
    num_points: int
    free_share: float
    table: Int32[Array, "blocks"]
    keys: UInt32[Array, "cells"]
    codes: UInt8[Array, "cells"]
    rough_codes: UInt8[Array, "cells"]
    states: UInt8[Array, "cells"]
    num_rows: int
    num_shared: int
    dims: Int32[Array, "3"]
    centroid: Float32[Array, "3"]

    @property
    def has_free_space(self) -> bool:
        """Whether free space says on which side of its surfaces the map lies."""
        return self.free_share > 0.5

    @property
    def block(self) -> Block:
        """Where the pools lie, as the lookups take it."""
        origin, voxel_size = to_device(
            (np.asarray(self.grid.origin, np.float32), np.float32(self.grid.voxel_size))
        )
        return Block(self.dims, origin, voxel_size, self.table)

    @property
    def num_blocks(self) -> int:
        """Number of blocks of the box, with which the table begins."""
        return math.prod(lattice_shape(self.grid.shape))

    def near_cells(self) -> tuple[UInt32[np.ndarray, "cells"], UInt8[np.ndarray, "cells"]]:
        """Keys and states of all cells of the pools that are not padding."""
        cells = slice(0, self.num_rows * BLOCK_VOXELS)
        return np.asarray(self.keys)[cells], np.asarray(self.states)[cells]

    def voxels_at(self, cells: Int[np.ndarray, "m"]) -> Int[np.ndarray, "m 3"]:
        """Voxels of cells of the pools that stand for one block alone, as those near occupied voxels do."""
        table = np.asarray(self.table)[: self.num_blocks]
        own = np.flatnonzero(table >= self.num_shared)
        row, within = cells // BLOCK_VOXELS, cells % BLOCK_VOXELS
        block = np.unravel_index(own[row - self.num_shared], lattice_shape(self.grid.shape))
        places = np.unravel_index(within, (BLOCK,) * 3)
        return np.stack([BLOCK * b + p for b, p in zip(block, places, strict=True)], axis=-1)

    def coarse_codes(self, factor: int = COARSE_FACTOR) -> UInt8[Array, "cells"]:
        """Evidence codes at the tolerance of cells `factor` voxels wide."""
        if factor == COARSE_FACTOR:
            return self.rough_codes
        return _codes(self.states, self.keys, self.num_rows, _coarse_bounds(factor))


def _coarse_bounds(factor: int) -> tuple[int, int]:
    """A hit lies within three quarters of a cell of something occupied, clear space half a voxel farther."""
    reach = 0.75 * factor
    return int(reach**2), min(int((reach + 0.5) ** 2), FIELD_RADIUS**2)


def _codes(states: Array, keys: Array, num_rows: int, bounds: tuple[int, int]) -> UInt8[Array, "cells"]:
    return code_pool(states, keys, num_rows, hit_sq=bounds[0], clear_sq=bounds[1])


class MapSurface(NamedTuple):
    """A map and what its surface looks like: enough to tell how much free space lies before it.

    Attributes:
        grid: The map, cut to what is known.
        index: Its occupied voxels, int32 (n, 3).
        moments: The surface around each of them.
    """

    grid: VoxelGrid
    index: Int32[np.ndarray, "n 3"]
    moments: SurfaceMoments

    @property
    def free_share(self) -> float:
        """Share of the occupied voxels with free space on one side of them."""
        return float(np.asarray(self.moments.has_free).mean())


def map_surface(grid: VoxelGrid) -> MapSurface:
    """The part of `prepare_map` that takes little time.

    Args:
        grid: As `prepare_map` takes it.

    Raises:
        InputError: As from `prepare_map`.
    """
    grid = grid.crop_to_known()
    check_resolution(grid)
    index = grid.occupied_index()
    return MapSurface(grid, index, tiled_moments(grid.states_in, grid.shape, index, size=7, reach=3))


def prepare_map(grid: VoxelGrid | MapSurface) -> PreparedMap:
    """Compute the fields and surface of a map.

    Args:
        grid: At the working voxel size, with at least one occupied voxel; its `map_surface` where that is known.

    Raises:
        InputError: If the map lies so far from the origin of its frame that float32 does not tell its voxels apart.
    """
    # Squared distances [voxel^2]: a hit lies within 1.5 voxels of something occupied, clear space two or more away.
    hit_sq, clear_sq = 2, 4
    # Below it a normal does not say which side of a surface is free.
    min_planarity = 0.3
    surface = grid if isinstance(grid, MapSurface) else map_surface(grid)
    grid, index, moments = surface
    pools = map_pools(grid.state_blocks(), index, radius=FIELD_RADIUS)
    # What kernels look up has one of few lengths, so that another map compiles nothing new.
    *_, rows = pool_lengths(math.prod(lattice_shape(grid.shape)), pools.num_rows, len(index))

    normals, curvature, offset = (np.asarray(a) for a in (moments.normal, moments.curvature, moments.offset))
    planarity = _planarity(curvature, np.asarray(moments.num_occupied))
    is_planar = planarity > min_planarity
    points = grid.world_from_index(index).astype(np.float32)
    # Voxel centres are off the surface by up to half a voxel, all alike where a wall lies along the grid; the plane
    # through the neighbourhood takes that out.
    anchors = points + normals * (offset * is_planar * np.float32(grid.voxel_size))[:, None]

    def table(values: np.ndarray) -> Array:
        return to_device(as_table(values.astype(np.float32, copy=False), rows))

    codes = partial(_codes, pools.states, pools.keys, pools.num_rows)
    return PreparedMap(
        grid=grid,
        points=table(points),
        anchors=table(anchors),
        normals=table(normals),
        sides=table(normals * is_planar[:, None]),
        weights=table(leverage_weights(normals, planarity)),
        planarity=table(planarity),
        num_points=len(index),
        free_share=surface.free_share,
        codes=codes((hit_sq, clear_sq)),
        rough_codes=codes(_coarse_bounds(COARSE_FACTOR)),
        dims=to_device(np.asarray(grid.shape, np.int32)),
        **pools._asdict(),
        centroid=to_device(points.mean(axis=0, dtype=np.float64).astype(np.float32)),
    )


def sample_rows(prepared: PreparedMap, count: int) -> np.ndarray:
    """Rows of `count` voxels drawn by their leverage."""
    return draw_rows(np.asarray(prepared.weights)[: prepared.num_points], count)


def draw_rows(weights: np.ndarray, count: int) -> np.ndarray:
    """`count` rows drawn evenly along the cumulated weights (n,), so that the same weights give the same rows."""
    cumulated = np.cumsum(weights, dtype=np.float64)
    # The middles of equal steps are taken, so that a row comes as often as its weight says, without chance.
    at = (np.arange(count) + 0.5) / count * cumulated[-1]
    return np.minimum(np.searchsorted(cumulated, at), len(weights) - 1)


def _planarity(curvature: np.ndarray, num_occupied: np.ndarray) -> np.ndarray:
    """1 on a plane, 0 from half the curvature of a ball on; 0 where too few voxels define a normal."""
    # Fewer occupied voxels in the window than this (a line has 7) do not define a normal.
    min_neighbours = 10
    return (np.clip(1.0 - 6.0 * curvature, 0.0, 1.0) * (num_occupied >= min_neighbours)).astype(np.float32)


def leverage_weights(normals: np.ndarray, planarity: np.ndarray) -> np.ndarray:
    """Share of each voxel in what fixes a translation, float32 (n,), sum 1.

    The leverage `n M^-1 n` of a normal in `M = sum n n^T` is small where many voxels say the same. A tenth of the
    weight is spread evenly, so that clutter without a normal counts too.
    """
    # By columns: three times as fast.
    x, y, z = columns = np.ascontiguousarray(normals.T, np.float64) * np.sqrt(planarity, dtype=np.float64)
    # The diagonal keeps the inverse finite where no surface fixes a direction.
    information = columns @ columns.T + 1e-3 * max(len(normals), 1) * np.eye(3)
    inverse = np.linalg.inv(information)
    leverage = x * (inverse[0, 0] * x + 2.0 * inverse[0, 1] * y + 2.0 * inverse[0, 2] * z)
    leverage += y * (inverse[1, 1] * y + 2.0 * inverse[1, 2] * z) + inverse[2, 2] * z * z
    # Leverages add up to about 3, hence 0.3 for about a tenth.
    weights = leverage + 0.3 / len(normals)
    return (weights / weights.sum()).astype(np.float32)
