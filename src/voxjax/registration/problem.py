"""From two maps to the residuals between them: what host code decides before anything is differentiated."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._types import Array
from ..refinement.losses import Loss
from ..refinement.planes import MIN_PLANARITY, SLIDE_WEIGHT, Planes, Sample, Surface
from ..refinement.pose import PoseProblem
from .prepared import PreparedMap, sample_rows


def surface_of(prepared: PreparedMap, *, is_signed: bool) -> Surface:
    """What the residuals need of a map; `is_signed` if free space tells sides apart in both maps."""
    rows = prepared.anchors, prepared.normals, prepared.planarity
    dims, origin, voxel_size = prepared.block
    return Surface(prepared.keys, dims, origin, voxel_size, *rows, jnp.asarray(is_signed))


def sample_of(prepared: PreparedMap, num_points: int) -> Sample:
    """`num_points` voxels of a map, drawn by leverage; voxels repeat where the map has fewer."""
    rows = sample_rows(prepared, num_points)
    weights = np.full(num_points, 1.0 / num_points, np.float32)
    is_planar = np.asarray(prepared.planarity)[rows] > MIN_PLANARITY
    normals = np.where(is_planar[:, None], np.asarray(prepared.normals)[rows], np.float32(0.0))
    return Sample(np.asarray(prepared.anchors)[rows], normals, weights, np.asarray(prepared.centroid))


def plane_problem(
    a: PreparedMap,
    b: PreparedMap,
    *,
    num_points: int = 8192,
    loss: Loss = "geman_mcclure",
    both_ways: bool = False,
) -> PoseProblem:
    """Points of b against the planes of a, and with `both_ways` points of a against the planes of b as well.

    Args:
        a: The map whose frame the pose maps into.
        b: The map that is moved.
        num_points: Voxels of each sample, chosen by what they rule out.
        loss: What a large offset costs.
        both_ways: Each way then has half of the weight: the errors of both maps' planes average out, and the maps the
            other way round give the inverse pose.
    """
    is_signed = a.has_free_space and b.has_free_space
    slide = np.asarray(SLIDE_WEIGHT, np.float32)
    sample = sample_of(b, num_points)
    forward = Planes(surface_of(a, is_signed=is_signed), sample, slide, loss)
    terms = (forward,)
    if both_ways:
        back = sample_of(a, num_points)
        backward = Planes(surface_of(b, is_signed=is_signed), back, slide, loss, is_inverse=True)
        terms = tuple(
            Planes(t.surface, t.sample._replace(weights=0.5 * t.sample.weights), slide, loss, t.is_inverse)
            for t in (forward, backward)
        )
    return PoseProblem(terms, sample.centroid, radius_of(sample))


def radius_of(sample: Sample) -> Float[Array, ""]:
    """Root mean square distance of the sample from the centroid [m]."""
    offset = np.asarray(sample.points) - np.asarray(sample.centroid)[None, :]
    return np.asarray(max(np.sqrt((offset**2).sum(axis=1).mean()), 1e-3), np.float32)


def as_dtype(problem: PoseProblem, dtype: np.typing.DTypeLike) -> PoseProblem:
    """The problem with its floating arrays in another dtype; float64 needs `jax_enable_x64`."""
    return jax.tree.map(
        lambda x: jnp.asarray(x, dtype) if jnp.issubdtype(x.dtype, jnp.floating) else x, problem
    )
