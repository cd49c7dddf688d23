"""`PreparedMap`: everything about one map that registration needs, computed once and used for all its pairs."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32, UInt8, UInt32

from .._buckets import bucket_size, flat_block, pad_rows
from .._types import Array
from ..grid import VoxelGrid
from ..ops.evidence import evidence_codes
from ..ops.moments import surface_moments
from ..ops.nearest import NOTHING_NEAR, nearest_field

FIELD_RADIUS = 5
"""Reach of the nearest-voxel field [voxel]: what refinement can pull in."""

HIT_SQ, CLEAR_SQ = 2, 4
"""A hit lies within 1.5 voxels of something occupied, clear space two voxels or more away."""

COARSE_CELL = 0.3
"""Unrefined poses are off by about so much [m], whatever the voxel size: with cells of 0.6 m, large maps of 0.2 m
voxels agree with each other everywhere, and the right pose drowned."""

SMALLEST_LIST = 16_384
"""Lists of voxels are padded to this at least: few rungs, so few shapes to compile."""

MIN_NEIGHBOURS = 10
"""Fewer occupied voxels in the window than this (a line has 7) do not define a normal."""

MIN_PLANARITY = 0.3
"""Below it a normal does not say which side of a surface is free."""


class PreparedMap(eqx.Module):
    """One map, ready to be registered with any other of the same working voxel size.

    Attributes:
        grid: The map at the working voxel size, cut to what is known.
        points: Occupied voxel centres [m], padded to a rung of the ladder.
        anchors: The same points moved onto the planes through their neighbourhoods [m], which takes out most of what
            the grid rounded; voxel centres where there is no plane.
        normals: Unit normals, toward free space where the map has any.
        sides: Normals where they say which side is free, rows of zero elsewhere.
        weights: Leverage of each voxel: how much it rules out; sums to 1, 0 for padding. Floors and ceilings together
            weigh as much as the walls along one axis, whatever their areas.
        planarity: In [0, 1], 0 for padding.
        num_points: Number of rows that are not padding.
        free_share: Share of the occupied voxels with free space on one side of them.
        keys: Flat field of the nearest occupied voxel.
        codes: Flat evidence codes at the tolerance of the voxel size.
        states: Flat states.
        dims: Size of the block [voxel].
        centroid: Of the occupied voxels [m], float32 (3,).
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
    keys: UInt32[Array, "flat"]
    codes: UInt8[Array, "flat"]
    states: UInt8[Array, "flat"]
    dims: Int32[Array, "3"]
    centroid: Float32[Array, "3"]

    @property
    def has_free_space(self) -> bool:
        """Whether free space says on which side of its surfaces the map lies."""
        return self.free_share > 0.5

    @property
    def block(self) -> tuple[Array, Array, Array]:
        """Dims, origin and voxel size, as the lookups take them."""
        return self.dims, jnp.asarray(self.grid.origin), jnp.float32(self.grid.voxel_size)

    @property
    def coarse_factor(self) -> int:
        """Width of a coarse cell [voxel], 2 or 3."""
        return int(np.clip(np.ceil(COARSE_CELL / self.grid.voxel_size - 1e-3), 2, 3))

    def coarse_codes(self, factor: int) -> UInt8[Array, "flat"]:
        """Evidence codes at the tolerance of cells `factor` voxels wide.

        A hit lies within three quarters of a cell of something occupied, clear space half a voxel farther.
        """
        reach = 0.75 * factor
        return evidence_codes(
            self.states, self.keys, int(reach**2), min(int((reach + 0.5) ** 2), FIELD_RADIUS**2)
        )


def prepare_map(grid: VoxelGrid) -> PreparedMap:
    """Compute the fields and surface of a map.

    Args:
        grid: At the working voxel size, with at least one occupied voxel.
    """
    grid = grid.crop_to_known()
    states = np.asarray(grid.states)
    index = grid.occupied_index()
    count = len(index)
    size = bucket_size(count, SMALLEST_LIST)
    padded = pad_rows(index, size)
    mask = np.arange(size) < count
    dims = jnp.asarray(states.shape, jnp.int32)
    flat = flat_block(states)

    keys = nearest_field(padded, mask, dims, flat_size=len(flat), radius=FIELD_RADIUS)
    moments = surface_moments(states, padded, size=7, reach=3)
    normals = np.asarray(moments.normal)[:count]
    planarity = _planarity(np.asarray(moments.curvature)[:count], np.asarray(moments.num_occupied)[:count])
    points = grid.world_from_index(index)
    offset = np.asarray(moments.offset)[:count] * (planarity > MIN_PLANARITY) * grid.voxel_size
    anchors = (points + normals * offset[:, None]).astype(np.float32)
    return PreparedMap(
        grid=grid,
        points=jnp.asarray(pad_rows(points, size)),
        anchors=jnp.asarray(pad_rows(anchors, size)),
        normals=jnp.asarray(pad_rows(normals, size)),
        sides=jnp.asarray(pad_rows(normals * (planarity > MIN_PLANARITY)[:, None], size)),
        weights=jnp.asarray(pad_rows(leverage_weights(normals, planarity), size)),
        planarity=jnp.asarray(pad_rows(planarity, size)),
        num_points=count,
        free_share=float(np.asarray(moments.has_free)[:count].mean()),
        keys=keys,
        codes=evidence_codes(flat, keys, HIT_SQ, CLEAR_SQ),
        states=jnp.asarray(flat),
        dims=dims,
        centroid=jnp.asarray(points.mean(axis=0, dtype=np.float64).astype(np.float32)),
    )


def share_sizes(maps: Sequence[PreparedMap]) -> list[PreparedMap]:
    """The same maps, padded to the largest of them, so that all their pairs run the same compiled kernels."""
    length = max(len(m.points) for m in maps)
    volume = max(len(m.states) for m in maps)
    return [
        m if len(m.points) == length and len(m.states) == volume else _padded(m, length, volume) for m in maps
    ]


def sample_rows(prepared: PreparedMap, count: int) -> np.ndarray:
    """Rows of `count` voxels drawn evenly along the cumulated leverage; deterministic."""
    cumulated = np.cumsum(np.asarray(prepared.weights, np.float64)[: prepared.num_points])
    at = (np.arange(count) + 0.5) / count * cumulated[-1]
    return np.minimum(np.searchsorted(cumulated, at), prepared.num_points - 1)


def _padded(prepared: PreparedMap, length: int, volume: int) -> PreparedMap:
    lists = ("points", "anchors", "normals", "sides", "weights", "planarity")
    blocks = {"keys": NOTHING_NEAR, "codes": 0, "states": 0}
    changed = {name: pad_rows(np.asarray(getattr(prepared, name)), length) for name in lists}
    for name, fill in blocks.items():
        changed[name] = pad_rows(np.asarray(getattr(prepared, name)), volume, int(fill))
    return eqx.tree_at(
        lambda m: [getattr(m, name) for name in changed], prepared, [jnp.asarray(v) for v in changed.values()]
    )


def _planarity(curvature: np.ndarray, num_occupied: np.ndarray) -> np.ndarray:
    """1 on a plane, 0 from half the curvature of a ball on; 0 where too few voxels define a normal."""
    return (np.clip(1.0 - 6.0 * curvature, 0.0, 1.0) * (num_occupied >= MIN_NEIGHBOURS)).astype(np.float32)


def leverage_weights(normals: np.ndarray, planarity: np.ndarray) -> np.ndarray:
    """Share of each voxel in what fixes a translation, float32 (n,), sum 1.

    The leverage `n M^-1 n` of a normal in `M = sum n n^T` is small where many voxels say the same. A tenth of the
    weight is spread evenly, so that clutter without a normal counts too.
    """
    rows = normals.astype(np.float64) * np.sqrt(planarity.astype(np.float64))[:, None]
    information = rows.T @ rows + 1e-3 * max(len(rows), 1) * np.eye(3)
    leverage = np.einsum("ni,ij,nj->n", rows, np.linalg.inv(information), rows)
    weights = leverage + 0.3 / len(rows)
    return (weights / weights.sum()).astype(np.float32)
