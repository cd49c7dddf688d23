"""What residuals need of a map: the tables that points are held against, and points to hold against other maps."""

from collections.abc import Collection
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..._checks import InputError, check_count, shown
from ..._runtime.placement import to_device
from ..._types import FREE, OCCUPIED, Array
from ...maps.prepared import sample_rows
from ...ops.evidence.nearest import INDEX_BITS
from ..residuals.fields import Field
from ..residuals.planes import MIN_PLANARITY, NearestSurface, Sample
from .field_tables import distance_field_of, opinion_field_of
from .views import MapView, hard_view


class Target(NamedTuple):
    """A map as points of another are held against it; None for what the kinds of residuals do not read.

    Attributes:
        surface: Planes of the map.
        distances: Distance field of the map.
        opinions: What it says of each place.
        has_free_space: Whether its normals point to free space.
    """

    surface: NearestSurface
    distances: Field | None
    opinions: Field | None
    has_free_space: bool


class Points(NamedTuple):
    """A map's points as they are held against another; None for what the kinds of residuals do not read.

    Attributes:
        sample: Points on the planes of the map.
        opinions: Voxel centres near its surfaces, and what it says of each.
        has_free_space: Whether its normals point to free space.
    """

    sample: Sample
    opinions: tuple[Sample, Float[Array, "n"]] | None
    has_free_space: bool


def target_of(view: MapView, kinds: Collection[str]) -> Target:
    """What residuals of some kinds read of a map that points are held against."""
    surface = surface_of(view, is_signed=view.prepared.has_free_space)
    return Target(
        surface,
        distance_field_of(view.prepared, surface) if "distances" in kinds else None,
        opinion_field_of(view.prepared, view.said) if "occupancies" in kinds else None,
        view.prepared.has_free_space,
    )


def points_of(view: MapView, kinds: Collection[str], num_points: int) -> Points:
    """The points that residuals of some kinds bring onto another map."""
    opinions = _said_points(view, num_points) if "occupancies" in kinds else None
    return Points(sample_of(view, num_points), opinions, view.prepared.has_free_space)


def surface_of(view: MapView, *, is_signed: bool) -> NearestSurface:
    """What the residuals need of a map's planes; `is_signed` if free space tells sides apart in both maps."""
    dims, origin, voxel_size, table = view.prepared.block
    dtype = view.anchors.dtype
    return NearestSurface(
        keys=view.prepared.keys,
        dims=dims,
        origin=np.asarray(origin, dtype),
        voxel_size=np.asarray(voxel_size, dtype),
        points=view.anchors,
        normals=view.normals,
        planarity=view.planarity,
        is_signed=to_device(np.bool_(is_signed)),
        trust=view.occupancy,
        table=table,
    )


def check_num_points(num_points: object, most: int = 10_000_000) -> None:
    """Raise unless `num_points` is a size of a sample.

    A sample repeats the voxels of a map that has fewer, so the map bounds nothing: `most` does, as in `Config`.

    Raises:
        InputError: If it is no whole number from 1 to `most`.
    """
    if check_count("num_points", num_points, 1) > most:
        raise InputError(f"num_points must be at most {most}, got {shown(num_points)}; give fewer.")


def sample_of(view: MapView, num_points: int) -> Sample:
    """`num_points` voxels of a map, drawn by leverage; voxels repeat where the map has fewer."""
    prepared, dtype = view.prepared, view.anchors.dtype
    # Drawing by leverage makes equal weights right: what rules out much is drawn often.
    rows = sample_rows(prepared, num_points)
    weights = np.full(num_points, 1.0 / num_points, dtype)
    # A normal of length 0 says that there is no plane: `meet` then asks for no angle.
    is_planar = (np.asarray(prepared.planarity)[rows] > MIN_PLANARITY).astype(dtype)[:, None]
    centroid = np.asarray(prepared.centroid).astype(dtype)
    if view.occupancy is None:
        normals = np.asarray(view.normals)[rows] * is_planar
        return Sample(np.asarray(view.anchors)[rows], normals, weights, centroid)
    # Normals of points only decide what they match, which has no derivative.
    normals = jax.lax.stop_gradient(jnp.asarray(view.normals)[rows]) * is_planar
    return Sample(view.anchors[rows], normals, weights * view.occupancy[rows], centroid)


def centre_of(view: MapView, num_points: int) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """Centroid and radius [m] of a map by its states, which count as constants, in the dtype of the view."""
    hard, dtype = sample_of(hard_view(view.prepared), num_points), view.anchors.dtype
    return hard.centroid.astype(dtype), radius_of(hard).astype(dtype)


def radius_of(sample: Sample) -> Float[np.ndarray, ""]:
    """Root mean square distance of the sample from the centroid [m]."""
    offset = np.asarray(sample.points) - np.asarray(sample.centroid)[None, :]
    # The bound keeps a map of a single voxel from dividing by 0.
    return np.asarray(max(np.sqrt((offset**2).sum(axis=1).mean()), 1e-3), np.float32)


def _said_points(view: MapView, num_points: int) -> tuple[Sample, Float[Array, "n"]]:
    """Voxel centres near surfaces, as many free as occupied ones, with what the map says of them.

    The occupied ones are drawn by leverage, the free ones evenly.
    """
    # Free voxels up to two voxels from a surface say where it is not; farther ones agree under any
    # small motion.
    near_sq = 4
    prepared, dtype = view.prepared, view.anchors.dtype
    grid, count = prepared.grid, num_points // 2
    # Where nothing is near, the key gives a distance beyond all.
    keys, states = prepared.near_cells()
    near = np.flatnonzero((keys >> INDEX_BITS <= near_sq) & (states == FREE))
    rows = sample_rows(prepared, num_points - (count if len(near) else 0))
    index = grid.occupied_index()[rows]
    if len(near):
        # Free space has no leverage to draw by; every so many of its voxels in the order of the grid are as good.
        free = prepared.voxels_at(near)
        order = np.lexsort(free.T[::-1])
        chosen = order[(np.arange(count) * len(free)) // max(count, 1)]
        index = np.concatenate([index, free[chosen]])
    # Opinions are of voxels, so that these are centres and not places on planes.
    points = grid.world_from_index(index).astype(dtype)
    if view.said is None:
        is_occupied = grid.states_at(index) == OCCUPIED
        said = np.where(is_occupied, 1.0, -1.0).astype(dtype)
    else:
        said = jnp.asarray(view.said)[tuple(index.T)]
    weights = np.full(len(index), 1.0 / len(index), dtype)
    centroid = np.asarray(prepared.centroid).astype(dtype)
    return Sample(points, np.zeros_like(points), weights, centroid), said
