"""A map as the residuals see it: planes, trust and opinions, from its states or as functions of its log-odds."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from ..._checks import InputError
from ..._runtime.threads import spread
from ..._types import Array
from ...grid import VoxelGrid, check_grid
from ...maps.prepared import PreparedMap, prepare_map
from ...ops.surface.neighbourhood import Neighbourhood, neighbourhood
from ...ops.surface.soft_planes import soft_planes
from ..residuals.occupancy import opinion
from ..residuals.planes import MIN_PLANARITY


class MapView(NamedTuple):
    """What residuals need to know of the occupied voxels of a map; lists as long as each other, padded.

    Attributes:
        prepared: The map; decides which voxels there are, which are used, and which is nearest.
        anchors: (m, 3) points on the planes through the neighbourhoods [m].
        normals: (m, 3) unit vectors.
        planarity: (m,) in [0, 1].
        occupancy: (m,) probability of each voxel; None for 1.
        said: (x, y, z) opinions of all voxels of the prepared grid; None for those of its states.
    """

    prepared: PreparedMap
    anchors: Float[Array, "m 3"]
    normals: Float[Array, "m 3"]
    planarity: Float[Array, "m"]
    occupancy: Float[Array, "m"] | None = None
    said: Float[Array, "x y z"] | None = None


def hard_view(prepared: PreparedMap) -> MapView:
    """The map by its states."""
    return MapView(prepared, prepared.anchors, prepared.normals, prepared.planarity)


def as_view(given: MapView | PreparedMap) -> MapView:
    """The map as it is given; by its states if it is not a view."""
    return given if isinstance(given, MapView) else hard_view(given)


class SoftMap(NamedTuple):
    """The part of a soft map that does not depend on its log-odds, made once on the host.

    Attributes:
        prepared: The map by its states, cut to what is known.
        neighbours: Neighbourhoods of its occupied voxels.
        window: Where the cut lies in the whole grid.
    """

    prepared: PreparedMap
    neighbours: Neighbourhood
    window: tuple[slice, slice, slice]

    def view(self, log_odds: Float[Array, "x y z"]) -> MapView:
        """The map with these log-odds of the whole grid; a function of them alone, in their dtype, safe under grad.

        Planes are fitted with each voxel weighing as much as it is probably occupied, and points and surfaces weigh
        as much as well.
        """
        # All that follows has the dtype of the log-odds: float64 where derivatives are checked, though maps are
        # float32.
        odds = jnp.asarray(log_odds)[self.window]
        prepared, dtype = self.prepared, odds.dtype
        index = prepared.grid.occupied_index()
        length = self.neighbours.place.shape[0]
        probable = jax.nn.sigmoid(odds[tuple(index.T)])
        # Padding has a probability of 0 and drops out of every weighted sum.
        occupancy = jnp.zeros(length, dtype).at[: len(index)].set(probable)
        # Normals by the states only give the planes their side; the planes themselves follow the log-odds.
        normals, planarity = (
            jnp.asarray(np.asarray(rows)[:length], dtype) for rows in (prepared.normals, prepared.planarity)
        )
        points = jnp.asarray(np.asarray(prepared.points)[:length], dtype)
        planes = soft_planes(occupancy, normals, self.neighbours)
        # Which voxels have a plane is decided by the states: the step would have no derivative.
        is_planar = (planarity > MIN_PLANARITY).astype(dtype)
        offset = planes.offset * is_planar * jnp.asarray(prepared.grid.voxel_size, dtype)
        anchors = points + planes.normal * offset[:, None]
        return MapView(prepared, anchors, planes.normal, planes.planarity, occupancy, opinion(odds))


def soft_map(grid: VoxelGrid) -> SoftMap:
    """Prepare a map whose log-odds are to be differentiated; its states must be values, its log-odds are not read.

    Raises:
        InputError: If nothing is occupied, or the states are traced.
    """
    if isinstance(grid.states, Tracer):
        raise InputError(
            "states must be values, not traced: they decide which voxels are used; trace the log-odds only."
        )
    # Without its log-odds, which may be traced, the map can be prepared on the host.
    whole = VoxelGrid(grid.states, grid.origin, grid.voxel_size)
    if not whole.num_occupied:
        raise InputError("grid must have at least one occupied voxel, got none; there is nothing to refine.")
    prepared = prepare_map(whole)
    cut = prepared.grid
    # Preparing cut the map to what is known: log-odds of the whole grid have to be cut alike.
    low = np.rint((np.asarray(cut.origin) - np.asarray(whole.origin)) / whole.voxel_size).astype(int)
    x, y, z = (slice(int(a), int(a) + n) for a, n in zip(low, cut.shape, strict=True))
    return SoftMap(prepared, neighbourhood(cut.occupied_index(), cut.shape), (x, y, z))


def views_of(grids: Mapping[str, VoxelGrid | PreparedMap], *, soft: bool) -> list[MapView | None]:
    """Maps as the residuals see them; None for those without an occupied voxel.

    Args:
        grids: The maps, by the names that errors call them.
        soft: Weigh voxels by their probabilities; all maps must then be grids with log-odds.

    Raises:
        InputError: If one is no map, `soft` is set and a map has no log-odds, or it is not and they are traced.
    """
    for name, grid in grids.items():
        if not isinstance(grid, PreparedMap):
            check_grid(name, grid)
        if soft and (not isinstance(grid, VoxelGrid) or not grid.has_log_odds):
            raise InputError(
                f"{name} must be a VoxelGrid with log_odds if soft is True; give it log-odds or leave soft out."
            )
        # Blocks are never traced, and would be made dense by the question.
        if soft or not isinstance(grid, VoxelGrid) or grid.is_sparse:
            continue
        if isinstance(grid.log_odds, Tracer):
            raise InputError(
                f"{name} has traced log_odds, on which the result depends with soft=True only; set it."
            )

    def prepared(grid: VoxelGrid | PreparedMap) -> SoftMap | PreparedMap | None:
        if isinstance(grid, PreparedMap):
            return grid
        if not grid.num_occupied:
            return None
        return soft_map(grid) if soft else prepare_map(grid)

    def view(grid: VoxelGrid | PreparedMap, part: SoftMap | PreparedMap | None) -> MapView | None:
        if isinstance(part, SoftMap):
            assert isinstance(grid, VoxelGrid)  # checked above
            return part.view(jnp.asarray(grid.log_odds))
        return None if part is None else hard_view(part)

    # Views are made in this thread, to which all that is traced belongs.
    made = spread(prepared, grids.values())
    return [view(grid, part) for grid, part in zip(grids.values(), made, strict=True)]
