"""`VoxelGrid`: states of voxels and where they lie.

Axis order is x, y, z everywhere. Voxel (i, j, k) fills `origin + voxel_size * [i, i + 1)` along each axis
and its centre lies half a voxel further. States live on the host until a kernel takes them: as the dense array
that they were given as, in blocks (`ops.blocks.block_array`), whose box may be of any size, or in chunks of a store,
which are read as they are needed (`ops.blocks.chunked_array`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float, Int

from . import _grid_arrays
from ._checks import (
    InputError,
    check_count,
    check_list,
    check_pose,
    check_positive,
    check_type,
    check_voxel_size,
    shown,
)
from ._types import FREE, OCCUPIED, Array
from .frames import STEPS_PER_VOXEL, check_near
from .ops.blocks import kept
from .ops.blocks.block_array import BlockArray, Corner
from .ops.blocks.chunked_array import ChunkedArray
from .ops.blocks.kept import Sparse
from .ops.resampling.from_points import grid_from_points
from .ops.resampling.lattice import about_middle, origin_in_voxels
from .ops.resampling.rescale import rescale_states
from .ops.resampling.rescale_blocks import rescale_blocks
from .ops.resampling.rigid import resample_blocks, resample_rigid

if TYPE_CHECKING:
    from jaxtyping import Float32, UInt8


class VoxelGrid(eqx.Module):
    """A map: a box of voxels that are unknown, free or occupied.

    Attributes:
        origin: float64 (3,) [m] on the host: the outer corner of voxel (0, 0, 0). JAX's transformations take it as
            float32, unless they are told to keep float64: give them `localized` maps.
        voxel_size: Edge length of a voxel [m]; static under `jax.jit`.
    """

    _states: UInt8[Array, "x y z"] | Sparse
    origin: Float[Array, "3"]
    _log_odds: Float32[Array, "x y z"] | Sparse | None
    voxel_size: float = eqx.field(static=True)

    def __init__(self, states: object, origin: object, voxel_size: float, log_odds: object = None):
        """Check and convert; arrays of the right dtype are kept as they are, on host or device, and so are blocks.

        What JAX traces is checked for its shape alone: its values are not known yet.
        """
        self._states = states if isinstance(states, Sparse) else _grid_arrays.as_states(states)
        self.origin = _grid_arrays.as_place("origin", origin)
        self._log_odds = None
        if log_odds is not None:
            is_sparse = isinstance(log_odds, Sparse)
            self._log_odds = log_odds if is_sparse else _grid_arrays.as_float32("log_odds", log_odds)
        self.voxel_size = check_voxel_size(voxel_size)
        odds_shape = None if self._log_odds is None else self._log_odds.shape
        _grid_arrays.check_shapes(self._states.shape, self.origin, odds_shape)
        # Values come after shapes: they take a pass over the whole map.
        _grid_arrays.check_states(kept.checkable(self._states))
        _grid_arrays.check_origin(self.origin, self.shape, self.voxel_size)
        if self._log_odds is not None:
            _grid_arrays.check_log_odds(kept.checkable(self._log_odds))

    @classmethod
    def from_points(
        cls,
        points: object,
        *,
        voxel_size: float,
        sensor_origins: object = None,
        max_range: float | None = None,
    ) -> VoxelGrid:
        """Make a grid from a cloud.

        Args:
            points: (n, 3) [m].
            voxel_size: Edge length of a voxel [m].
            sensor_origins: None (all other voxels stay unknown), (3,) for a single scan or (n, 3), one a
                point [m]; with origins, the voxels that the rays cross are free.
            max_range: Rays longer than this [m] free space up to it and occupy nothing.

        Raises:
            InputError: If the cloud is not (n, 3) finite numbers, or would need more voxels than memory has room
                for.
        """
        states, origin = grid_from_points(
            points,
            voxel_size=voxel_size,
            sensor_origins=sensor_origins,
            max_range=max_range,
        )
        return cls(states, origin, voxel_size)

    @property
    def states(self) -> UInt8[Array, "x y z"]:
        """States uint8 (x, y, z): 0 unknown, 1 free, 2 occupied; a dense array.

        Of a map that is kept in blocks it is made when it is asked for, and read-only: make a `VoxelGrid` of a copy.

        Raises:
            InputError: If the map is kept in blocks, and there is not enough memory for the box.
        """
        return self._states.view() if isinstance(self._states, Sparse) else self._states

    @property
    def log_odds(self) -> Float32[Array, "x y z"] | None:
        """Log-odds float32 (x, y, z) like `states`, or None where the source had no probabilities.

        Raises:
            InputError: As from `states`.
        """
        return self._log_odds.view() if isinstance(self._log_odds, Sparse) else self._log_odds

    @property
    def is_sparse(self) -> bool:
        """Whether the map is kept in blocks, or read from a store as needed: `states` and `log_odds` are then made."""
        return isinstance(self._states, Sparse)

    @property
    def is_stored(self) -> bool:
        """Whether the map lies in a store, of which windows are read as they are asked for."""
        return isinstance(self._states, ChunkedArray)

    @property
    def has_log_odds(self) -> bool:
        """Whether there are log-odds, which are not made for that."""
        return self._log_odds is not None

    def state_blocks(self) -> BlockArray:
        """The states in blocks; those of a dense map are made at each call, those of a store read once and kept."""
        return kept.in_blocks(self._states)

    def log_odds_blocks(self) -> BlockArray | None:
        """The log-odds in blocks like `state_blocks`, or None."""
        return None if self._log_odds is None else kept.in_blocks(self._log_odds)

    def states_in(self, low: Corner, high: Corner) -> UInt8[np.ndarray, "x y z"]:
        """States of a window of the box, dense: from voxel `low` up to and without `high`, both inside the box."""
        return kept.window(self._states, low, high)

    def log_odds_in(self, low: Corner, high: Corner) -> Float32[np.ndarray, "x y z"] | None:
        """Log-odds of a window of the box like `states_in`, or None."""
        return None if self._log_odds is None else kept.window(self._log_odds, low, high)

    def cubes(self, side: int) -> Int[np.ndarray, "m 3"]:
        """Cubes of the box that may hold something, in lexicographic order; all of a dense map.

        Args:
            side: Sides of the cubes [voxel], which are whole blocks; cube (i, j, k) begins at voxel side * (i, j, k).
        """
        found = kept.cubes_of(self._states, side)
        return np.argwhere(found if self._log_odds is None else found | kept.cubes_of(self._log_odds, side))

    def states_at(self, index: Int[np.ndarray, "n 3"]) -> UInt8[np.ndarray, " n"]:
        """States of voxels inside the box."""
        return kept.take(self._states, index)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of voxels along x, y, z."""
        return self._states.shape  # pyright: ignore[reportReturnType]

    @property
    def num_voxels(self) -> int:
        """Number of voxels of the box, known or not."""
        return math.prod(self.shape)

    @property
    def num_occupied(self) -> int:
        """Number of occupied voxels."""
        return kept.count(self._states, OCCUPIED)

    @property
    def num_free(self) -> int:
        """Number of free voxels."""
        return kept.count(self._states, FREE)

    @property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest outer corner [m], each float64 (3,)."""
        low = np.array(self.origin, np.float64)  # a copy: who changes the corner must not move the map
        return low, low + self.voxel_size * np.asarray(self.shape, np.float64)

    def occupied_index(self) -> np.ndarray:
        """Indices of the occupied voxels, int32 (n, 3), in lexicographic order.

        Raises:
            InputError: If there is not enough memory for the list, which may be many times as large as a file was.
        """
        return kept.where(self._states, OCCUPIED, "occupied")

    def occupied_points(self) -> np.ndarray:
        """Centres of the occupied voxels, float64 (n, 3) [m], same order as `occupied_index`."""
        return self.world_from_index(self.occupied_index())

    def world_from_index(self, index: Int[Array, "*n 3"] | Float[Array, "*n 3"]) -> np.ndarray:
        """Centres, float64 [m], of voxel indices; fractional indices are fine."""
        places = np.array(index, np.float64)
        # In place: each step would otherwise leave a list twice as large as what is given.
        places += 0.5
        places *= self.voxel_size
        places += np.asarray(self.origin, np.float64)
        return places

    def index_from_world(self, points: Float[Array, "*n 3"]) -> np.ndarray:
        """Indices int32 of the voxels that hold the points [m]; may lie outside the grid.

        Raises:
            InputError: If a point is not finite, or more than 2**31 voxels away.
        """
        offset = (np.asarray(points, np.float64) - np.asarray(self.origin, np.float64)) / self.voxel_size
        # A cast of larger numbers to int32 would give some other voxel in silence; NaN fails the comparison,
        # too.
        if not (np.abs(offset) < 2.0**31).all():
            raise InputError(
                f"points must be finite and within 2**31 voxels of the origin, got {shown(np.asarray(points))}."
            )
        return np.floor(offset).astype(np.int32)

    def crop_to_known(self, margin: int = 0) -> VoxelGrid:
        """Cut to the box around the free and occupied voxels, and `margin` voxels where the grid has them.

        A grid with nothing known becomes one unknown voxel at the same origin.

        Raises:
            InputError: If `margin` is no whole number, 0 or more.
        """
        margin = check_count("margin", margin)
        if not all(self.shape):  # an empty grid is taken for one that knows nothing
            return VoxelGrid(np.zeros((1, 1, 1), np.uint8), self.origin, self.voxel_size)
        low, high = self.known_box()
        if (low == high).all():
            return self.cut(low, low + 1)
        return self.cut(np.maximum(low - margin, 0), np.minimum(high + margin, self.shape))

    def known_box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest free or occupied voxel and one past the highest, int64 (3,) each; both 0 where nothing is known."""
        return kept.known_box(self._states)

    def cut(self, low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]) -> VoxelGrid:
        """The part from voxel `low` up to and without `high`, both inside the box; see `kept.part`."""
        origin = np.asarray(self.origin, np.float64) + np.asarray(low, np.float64) * self.voxel_size
        log_odds = None if self._log_odds is None else kept.part(self._log_odds, low, high)
        return VoxelGrid(kept.part(self._states, low, high), origin, self.voxel_size, log_odds)

    def localized(self) -> tuple[VoxelGrid, np.ndarray]:
        """This map in a local frame, for whatever computes in float32.

        Returns:
            The same voxels with their origin moved, so that zero lies at a border of voxels in the middle of the grid;
            and the place of that zero in the map's own frame, float64 (3,) [m]. Poses between such frames come from
            `frames.to_local`, and go back with `frames.from_local`.
        """
        origin, place = about_middle(np.asarray(self.origin), self.shape, self.voxel_size)
        # States and log-odds, which may be traced, are not looked at again.
        return eqx.tree_at(lambda grid: grid.origin, self, origin), place

    def placed(self, *, scale: float = 1.0, shift: object = (0.0, 0.0, 0.0)) -> VoxelGrid:
        """The same voxels at other places: all lengths times `scale`, and then moved by `shift` (3,) [m].

        Nothing is resampled or copied. Of a map in millimetres, `scale=0.001` makes one in metres.

        Raises:
            InputError: If `scale` is not above 0, `shift` not three numbers, or the map would reach too far.
        """
        factor = check_positive("scale", scale)
        origin = np.asarray(self.origin, np.float64) * factor + _grid_arrays.as_place("shift", shift)
        return VoxelGrid(self._states, origin, self.voxel_size * factor, self._log_odds)

    def with_voxel_size(self, voxel_size: float) -> VoxelGrid:
        """Return this map at another resolution, on the lattice of multiples of `voxel_size`.

        Coarser: a voxel is occupied if any of its parts is, else free if any part is free, and has the highest of
        their log-odds. Finer: voxels are split. The ratio may be any number: each fine voxel goes where its centre
        lies. What is sparse stays sparse.

        Raises:
            InputError: If `voxel_size` is no length above zero, or so small that the memory does not suffice.
        """
        voxel_size = check_voxel_size(voxel_size)
        cell = origin_in_voxels(np.asarray(self.origin), voxel_size)
        # A grid between the cells of the lattice moves onto it even at its own voxel size.
        if voxel_size == self.voxel_size and (cell == np.rint(cell)).all():
            return self
        old, new = np.asarray(self.origin), (self.voxel_size, voxel_size)
        if self.is_sparse:
            states, origin, log_odds = rescale_blocks(self.state_blocks(), old, *new, self.log_odds_blocks())
        else:
            states, origin, log_odds = rescale_states(
                np.asarray(self.states), old, *new, self._odds_on_host()
            )
        return VoxelGrid(states, origin, voxel_size, log_odds)

    def _odds_on_host(self) -> np.ndarray | None:
        return None if self.log_odds is None else np.asarray(self.log_odds)

    def transformed(self, T: object) -> VoxelGrid:
        """The map moved by the rigid transform `T` (4, 4) and resampled on a lattice of the same voxel size.

        Backward lookup of the nearest voxel, so that surfaces get no holes. The origin of the result is a
        whole multiple of the voxel size; under the 24 rotations of the cube the whole grid is kept, under
        others the box around what is known. What is sparse stays sparse.
        """
        place = np.asarray(self.origin), self.voxel_size, check_pose("T", T)
        if self.is_sparse:
            states, origin, log_odds = resample_blocks(self.state_blocks(), *place, self.log_odds_blocks())
        else:
            states, origin, log_odds = resample_rigid(np.asarray(self.states), *place, self._odds_on_host())
        return VoxelGrid(states, origin, self.voxel_size, log_odds)

    def equals(self, other: VoxelGrid) -> bool:
        """Whether both hold the same voxels at the same places (geometry, states and log-odds).

        Places are the same up to rounding: 7 times 0.2 m is not the number 1.4.
        """
        if self.shape != other.shape or self.voxel_size != other.voxel_size:
            return False
        apart = np.abs(np.asarray(self.origin, np.float64) - np.asarray(other.origin, np.float64))
        return bool(
            (apart * STEPS_PER_VOXEL < self.voxel_size).all()
            and kept.same(self._log_odds, other._log_odds)
            and kept.same(self._states, other._states)
        )

    def __eq__(self, other: object) -> bool:
        """Same as `equals`; False for other types."""
        return isinstance(other, VoxelGrid) and self.equals(other)

    # Equality looks at arrays, which have no hash.
    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def __repr__(self) -> str:
        """One line: shape, voxel size, extent and the share of each state."""
        # Under a transformation of JAX there are no values to count.
        values = kept.checkable(self._states)
        if not isinstance(values, np.ndarray) and not hasattr(values, "__array__"):
            return f"VoxelGrid(states={values}, voxel_size={self.voxel_size})"
        # A store is not read for a line of text.
        is_counted = not isinstance(self._states, ChunkedArray) or self._states.is_surveyed
        counts = {"occupied": self.num_occupied, "free": self.num_free} if is_counted else None
        box = _grid_arrays.grid_text(self.shape, self.voxel_size, self.extent, counts)
        return f"VoxelGrid({box}{', with log-odds' if self._log_odds is not None else ''})"


def check_grid(name: str, value: object) -> None:
    """Raise if an argument is no map, such as the name of a file, or JAX has lost where it lies.

    Raises:
        InputError: If `value` is no `VoxelGrid`, or its origin went through `jax.device_put` or `jax.jit` far from the
            origin of its frame, where float32 does not tell voxels apart.
    """
    check_type(name, value, VoxelGrid, "read it with vx.read_map")
    assert isinstance(value, VoxelGrid)
    # `VoxelGrid` makes origins arrays of the host; JAX replaces them with its own when it moves whole maps.
    origin = value.origin
    if isinstance(origin, jax.Array) and not isinstance(origin, Tracer) and origin.dtype != np.float64:
        advice = "JAX has rounded its origin; give JAX grid.localized()"
        check_near(name, *value.extent, value.voxel_size, advice)


def check_grids(name: str, values: object) -> list[VoxelGrid]:
    """Return maps as a list.

    Raises:
        InputError: If `values` is no list, or one of them cannot be used, see `check_grid`.
    """
    grids = check_list(name, values, "VoxelGrid maps")
    for number, grid in enumerate(grids):
        check_grid(f"{name}[{number}]", grid)
    return grids


def check_resolution(grid: VoxelGrid) -> None:
    """Refuse a map whose places float32 does not tell apart, where its positions are measured in its own frame.

    Raises:
        InputError: If the map lies too far from the origin of its frame.
    """
    check_near("a map", *grid.extent, grid.voxel_size, "give grid.localized()")
