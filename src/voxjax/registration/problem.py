"""From two maps to the residuals between them: what host code decides before anything is differentiated."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._checks import InputError
from .._types import FREE, OCCUPIED, Array
from ..ops.nearest import split_keys
from ..refinement.distance import Distances
from ..refinement.losses import Loss
from ..refinement.occupancy import Occupancies
from ..refinement.planes import MIN_PLANARITY, SLIDE_WEIGHT, Planes, Sample, Surface
from ..refinement.problem import PoseProblem
from ..refinement.terms import Term
from .fields import distance_field_of, opinion_field_of
from .map_views import MapView, hard_view
from .prepared import PreparedMap, sample_rows

KINDS = ("planes", "distances", "occupancies")
"""Residuals that can be asked for by name."""

NEAR_SQ = 4
"""Free voxels up to two voxels from a surface say where it is not; farther ones agree under any small motion."""


def surface_of(view: MapView, *, is_signed: bool) -> Surface:
    """What the residuals need of a map's planes; `is_signed` if free space tells sides apart in both maps."""
    dims, origin, voxel_size = view.prepared.block
    dtype = view.anchors.dtype
    return Surface(
        keys=view.prepared.keys,
        dims=dims,
        origin=np.asarray(origin, dtype),
        voxel_size=np.asarray(voxel_size, dtype),
        points=view.anchors,
        normals=view.normals,
        planarity=view.planarity,
        is_signed=jnp.asarray(is_signed),
        trust=view.occupancy,
    )


def sample_of(view: MapView, num_points: int) -> Sample:
    """`num_points` voxels of a map, drawn by leverage; voxels repeat where the map has fewer."""
    prepared, dtype = view.prepared, view.anchors.dtype
    rows = sample_rows(prepared, num_points)
    weights = np.full(num_points, 1.0 / num_points, dtype)
    is_planar = (np.asarray(prepared.planarity)[rows] > MIN_PLANARITY).astype(dtype)[:, None]
    centroid = np.asarray(prepared.centroid).astype(dtype)
    if view.occupancy is None:
        normals = np.asarray(view.normals)[rows] * is_planar
        return Sample(np.asarray(view.anchors)[rows], normals, weights, centroid)
    normals = jax.lax.stop_gradient(jnp.asarray(view.normals)[rows]) * is_planar
    return Sample(view.anchors[rows], normals, weights * view.occupancy[rows], centroid)


def pose_problem(
    a: MapView | PreparedMap,
    b: MapView | PreparedMap,
    *,
    residuals: Mapping[str, float] | None = None,
    num_points: int = 8192,
    loss: Loss = "geman_mcclure",
    both_ways: bool = False,
) -> PoseProblem:
    """Residuals of points of b against map a, and with `both_ways` of points of a against map b as well.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        residuals: Kinds and their weights: "planes" (point to plane), "distances" (truncated distance field),
            "occupancies" (soft agreement of occupied, free and unknown). None: planes alone.
        num_points: Voxels of each sample, chosen by what they rule out.
        loss: What a large offset costs; of occupancies it is squared.
        both_ways: Each way then has half of the weight: the errors of both maps average out, and the maps the other
            way round give the inverse pose.

    Raises:
        InputError: If a kind is not known or a weight not positive.
    """
    residuals = {"planes": 1.0} if residuals is None else dict(residuals)
    for kind, weight in residuals.items():
        if kind not in KINDS:
            raise InputError(f"residuals must be among {', '.join(KINDS)}, got {kind!r}.")
        if not weight > 0:
            raise InputError(f"residuals must have positive weights, got {weight} for {kind!r}.")
    if not residuals:
        raise InputError(f"residuals must name at least one of {', '.join(KINDS)}, got none.")
    a, b = (view if isinstance(view, MapView) else hard_view(view) for view in (a, b))
    ways = [(a, b, False), (b, a, True)] if both_ways else [(a, b, False)]
    terms = [
        _term(kind, *way, share=weight / len(ways), num_points=num_points, loss=loss)
        for kind, weight in residuals.items()
        for way in ways
    ]
    hard = sample_of(hard_view(b.prepared), num_points)
    dtype = b.anchors.dtype
    return PoseProblem(tuple(terms), hard.centroid.astype(dtype), radius_of(hard).astype(dtype))


def _term(
    kind: str, target: MapView, other: MapView, is_inverse: bool, *, share: float, num_points: int, loss: Loss
) -> Term:
    """Residuals of one kind, one way, of `share` of the weight."""
    is_signed = target.prepared.has_free_space and other.prepared.has_free_space
    if kind == "occupancies":
        sample, said = _said_points(other, num_points)
        field = opinion_field_of(target.prepared, target.said)
        return Occupancies(field=field, sample=_times(sample, share), said=said, is_inverse=is_inverse)
    surface, sample = surface_of(target, is_signed=is_signed), _times(sample_of(other, num_points), share)
    if kind == "distances":
        return Distances(distance_field_of(target.prepared, surface), sample, loss, is_inverse)
    return Planes(surface, sample, np.asarray(SLIDE_WEIGHT, surface.points.dtype), loss, is_inverse)


def _times(sample: Sample, share: float) -> Sample:
    return sample._replace(weights=sample.weights * np.asarray(share, sample.weights.dtype))


def _said_points(view: MapView, num_points: int) -> tuple[Sample, Float[Array, "n"]]:
    """Voxel centres near surfaces, as many free as occupied ones, with what the map says of them.

    The occupied ones are drawn by leverage, the free ones evenly.
    """
    prepared, dtype = view.prepared, view.anchors.dtype
    grid, count = prepared.grid, num_points // 2
    # Where nothing is near, the key gives a distance beyond all.
    _, distance_sq = split_keys(np.asarray(prepared.keys)[: grid.states.size])
    states = np.asarray(grid.states).reshape(-1)
    free = np.flatnonzero((np.asarray(distance_sq) <= NEAR_SQ) & (states == FREE))
    rows = sample_rows(prepared, num_points - (count if len(free) else 0))
    index = grid.occupied_index()[rows]
    if len(free):
        chosen = free[(np.arange(count) * len(free)) // max(count, 1)]
        index = np.concatenate([index, np.stack(np.unravel_index(chosen, grid.shape), axis=-1)])
    points = grid.world_from_index(index).astype(dtype)
    if view.said is None:
        is_occupied = np.asarray(grid.states)[tuple(index.T)] == OCCUPIED
        said = np.where(is_occupied, 1.0, -1.0).astype(dtype)
    else:
        said = jnp.asarray(view.said)[tuple(index.T)]
    weights = np.full(len(index), 1.0 / len(index), dtype)
    centroid = np.asarray(prepared.centroid).astype(dtype)
    return Sample(points, np.zeros_like(points), weights, centroid), said


def radius_of(sample: Sample) -> Float[np.ndarray, ""]:
    """Root mean square distance of the sample from the centroid [m]."""
    offset = np.asarray(sample.points) - np.asarray(sample.centroid)[None, :]
    return np.asarray(max(np.sqrt((offset**2).sum(axis=1).mean()), 1e-3), np.float32)


def as_dtype(problem: PoseProblem, dtype: type[np.floating]) -> PoseProblem:
    """The problem with its floating arrays in another dtype; float64 needs `jax_enable_x64`."""
    return jax.tree.map(
        lambda x: jnp.asarray(x, dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, problem
    )
