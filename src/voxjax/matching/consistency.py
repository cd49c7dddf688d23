"""Which associations can hold together: distances (equation 4), angles between frames, one-to-one.

The distances of all pairs of associations are one dense mask on the device; angles are looked at only where
the distances agree. Memory: one byte a pair, so 8000 associations (about 90 corners against 90) take 64 MB.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int, Int32

from .._checks import InputError, check_positive
from .._runtime.buckets import pad_rows, wide_bucket_size
from .._runtime.pieces import one_by_one, over_pieces
from .._types import Array
from ..features.types import Corners
from .associations import all_associations, check_associations, same_kind

DISTANCE_TOLERANCE = 0.2
"""D of equation (4) [m]: two voxels of a map of 10 cm, which is what two roundings and a little drift amount to."""

MAX_ASSOCIATIONS = 32768
"""More would take over a gigabyte; choose candidates first."""

_EDGE_CHUNK = 1 << 18


class ConsistencyGraph(eqx.Module):
    """Graph whose nodes are associations and whose edges say that two of them can hold together.

    Attributes:
        associations: int32 (m, 2): rows of the corners of a and of b; -1 in padding rows.
        adjacency: bool (m, m), symmetric, False on the diagonal and in padding rows.
        mask: bool (m,): which rows are associations; they come first.
    """

    associations: Int32[Array, "m 2"]
    adjacency: Bool[Array, "m m"]
    mask: Bool[Array, "m"]

    @property
    def num_associations(self) -> int:
        """Number of rows that are not padding."""
        return int(np.count_nonzero(np.asarray(self.mask)))


def consistency_graph(
    corners_a: Corners,
    corners_b: Corners,
    *,
    distance_tolerance: float = DISTANCE_TOLERANCE,
    angle_tolerance: float | None = None,
    min_distance: float = 0.0,
    match_kinds: bool = False,
    associations: Int[Array, "k 2"] | None = None,
) -> ConsistencyGraph:
    """Pairwise compatibility of candidate associations of corners.

    Two associations are compatible when they share no corner and the distance between their corners in a
    differs from the distance in b by less than the tolerance, equation (4).

    Args:
        corners_a: Corners of map a.
        corners_b: Corners of map b.
        distance_tolerance: D of equation (4) [m]; two voxels of a map of 10 cm unless given.
        angle_tolerance: If given [rad], the rotations that two associations imply (best over the cyclic
            orders of the corners' normals) must also agree within it.
        min_distance: Pairs of corners nearer than this in either map [m] do not count as compatible: almost
            coincident corners agree with everything.
        match_kinds: Whether only corners with equally many convex edges may match.
        associations: Candidates (k, 2), or None for all pairs.

    Returns:
        The graph, padded to a bucket; at most `MAX_ASSOCIATIONS` nodes.

    Raises:
        InputError: If a tolerance is not positive, an index does not exist, or there are too many
        associations.

    References:
        Section IV.B-C, equation (4).
    """
    if associations is None:
        associations = all_associations(corners_a.mask, corners_b.mask)
    if match_kinds:
        associations = same_kind(associations, corners_a.convexity, corners_b.convexity)
    pairs = check_associations(associations, len(corners_a.mask), len(corners_b.mask))
    adjacency = pairwise_consistency(
        corners_a.position, corners_b.position, pairs, distance_tolerance=distance_tolerance,
        min_distance=min_distance, angle_tolerance=angle_tolerance,
        frames_a=corners_a.normals if angle_tolerance is not None else None,
        frames_b=corners_b.normals if angle_tolerance is not None else None,
    )  # fmt: skip
    size = adjacency.shape[0]
    return ConsistencyGraph(pad_rows(pairs, size, -1.0), adjacency, np.arange(size) < len(pairs))


def pairwise_consistency(
    points_a: Float[Array, "n 3"],
    points_b: Float[Array, "p 3"],
    associations: Int[Array, "k 2"],
    *,
    distance_tolerance: float,
    min_distance: float = 0.0,
    angle_tolerance: float | None = None,
    frames_a: Float[Array, "n 3 3"] | None = None,
    frames_b: Float[Array, "p 3 3"] | None = None,
    normals_a: Float[Array, "n 3"] | None = None,
    normals_b: Float[Array, "p 3"] | None = None,
) -> np.ndarray:
    """Compatibility of associations of points, with optional frames (corners) or normals (surface points).

    Args:
        points_a: Points of a [m].
        points_b: Points of b [m].
        associations: Index pairs.
        distance_tolerance: D of equation (4) [m].
        min_distance: Nearer pairs [m] are not compatible.
        angle_tolerance: [rad], used with frames or normals.
        frames_a: Rows are three unit normals, in a cyclic order that is not known.
        frames_b: The same for b.
        normals_a: One unit normal a point: the three angles between two normals and the line through their
            points must agree in a and b.
        normals_b: The same for b.

    Returns:
        bool (m, m) on the host, m the bucket of the number of associations; False in padding.

    Raises:
        InputError: If a tolerance is not positive, an index does not exist, or there are too many
        associations.
    """
    check_positive("distance_tolerance", distance_tolerance, "m")
    pairs = check_associations(associations, len(points_a), len(points_b))
    if len(pairs) > MAX_ASSOCIATIONS:
        raise InputError(
            f"associations must be at most {MAX_ASSOCIATIONS}, got {len(pairs)}; give fewer candidates."
        )
    if angle_tolerance is not None:
        check_positive("angle_tolerance", angle_tolerance, "rad")
    size = wide_bucket_size(len(pairs), 256)
    nodes = [_gather(p, pairs[:, side], size) for side, p in enumerate((points_a, points_b))]
    adjacency = np.asarray(
        distance_consistency(
            *nodes, pad_rows(pairs, size, -1.0), np.float32(distance_tolerance), np.float32(min_distance)
        )
    )
    if angle_tolerance is None or (frames_a is None and normals_a is None):
        return adjacency
    tolerance = np.float32(angle_tolerance)
    adjacency = adjacency.copy()
    for given_a, given_b, test in (
        (frames_a, frames_b, rotations_agree),
        (normals_a, normals_b, normals_agree),
    ):
        if given_a is not None and given_b is not None:
            more = [_gather(g, pairs[:, side], size) for side, g in enumerate((given_a, given_b))]
            _keep_edges(adjacency, lambda edges, more=more, test=test: test(*nodes, *more, edges, tolerance))
    return adjacency


def _gather(rows: Array, index: np.ndarray, size: int) -> np.ndarray:
    """Rows of the associations on the host, float32, padded."""
    return pad_rows(np.asarray(rows, np.float32)[index], size)


def _keep_edges(adjacency: np.ndarray, agree) -> None:
    """Clear, in place, the edges that `agree` rejects; asks in chunks of one fixed shape."""
    edges = np.argwhere(np.triu(adjacency)).astype(np.int32)
    if len(edges) == 0:
        return
    # One chunk after the other: what one writes down in between is many times as large as its edges.
    is_kept = over_pieces(lambda chunk, _: agree(chunk), [edges], size=_EDGE_CHUNK, run=one_by_one)
    i, j = edges[~is_kept].T
    adjacency[i, j] = False
    adjacency[j, i] = False


@jax.jit
def distance_consistency(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    associations: Int32[Array, "m 2"],
    distance_tolerance: Float[Array, ""] | np.float32,
    min_distance: Float[Array, ""] | np.float32,
) -> Bool[Array, "m m"]:
    """Equation (4) for all pairs of associations at once, and one-to-one.

    Args:
        nodes_a: Point of a of each association [m].
        nodes_b: Point of b of each association [m].
        associations: Index pairs; negative in padding rows.
        distance_tolerance: D [m].
        min_distance: [m].
    """

    def distances(nodes: Array) -> Array:
        # Differences first, then squares: a Gram matrix would lose millimetres in float32.
        squared = jnp.zeros((nodes.shape[0], nodes.shape[0]), nodes.dtype)
        for axis in range(3):
            gap = nodes[:, axis][:, None] - nodes[:, axis][None, :]
            squared = squared + gap * gap
        return jnp.sqrt(squared)

    length_a, length_b = distances(nodes_a), distances(nodes_b)
    index_a, index_b = associations[:, 0], associations[:, 1]
    shares_corner = (index_a[:, None] == index_a[None, :]) | (index_b[:, None] == index_b[None, :])
    is_real = index_a >= 0
    return (
        (jnp.abs(length_a - length_b) < distance_tolerance)
        & (jnp.minimum(length_a, length_b) >= min_distance)
        & ~shares_corner
        & is_real[:, None]
        & is_real[None, :]
    )


def _cyclic_rotations(frames_a: Array, frames_b: Array) -> Array:
    """Rotations (m, 3, 3, 3) that carry frame b onto frame a, one for each cyclic order of its rows."""
    turned = jnp.stack([jnp.roll(frames_b, shift, axis=-2) for shift in range(3)], axis=-3)
    return jnp.einsum("mki,mskj->msij", frames_a, turned)


@jax.jit
def rotations_agree(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    frames_a: Float[Array, "m 3 3"],
    frames_b: Float[Array, "m 3 3"],
    edges: Int32[Array, "e 2"],
    angle_tolerance: Float[Array, ""] | np.float32,
) -> Bool[Array, "e"]:
    """Whether two associations imply one rotation, for some cyclic order of the normals of each.

    The trace of a relative rotation is `1 + 2 cos angle`; frames need not be exactly orthonormal. The nodes
    are not used: frames alone decide.
    """
    rotations = _cyclic_rotations(frames_a, frames_b)
    first, second = rotations[edges[:, 0]], rotations[edges[:, 1]]
    trace = jnp.max(jnp.einsum("esij,etij->est", first, second), axis=(1, 2))
    # Scaled by the size of the implied matrices, so that slightly skew frames do not fail for their skew.
    norm = jnp.linalg.norm(rotations.reshape(rotations.shape[0], 3, 9), axis=-1)[:, 0]
    scale = 3.0 / jnp.maximum(norm[edges[:, 0]] * norm[edges[:, 1]], 1e-12)
    return trace * scale >= 1.0 + 2.0 * jnp.cos(angle_tolerance)


@jax.jit
def normals_agree(
    nodes_a: Float[Array, "m 3"],
    nodes_b: Float[Array, "m 3"],
    normals_a: Float[Array, "m 3"],
    normals_b: Float[Array, "m 3"],
    edges: Int32[Array, "e 2"],
    angle_tolerance: Float[Array, ""] | np.float32,
) -> Bool[Array, "e"]:
    """Whether two normals and the line through their points make the same angles in both maps."""

    def cosines(nodes: Array, normals: Array) -> Array:
        i, j = edges[:, 0], edges[:, 1]
        line = nodes[j] - nodes[i]
        line = line / jnp.maximum(jnp.linalg.norm(line, axis=-1, keepdims=True), 1e-9)
        pairs = ((normals[i], normals[j]), (normals[i], line), (normals[j], line))
        return jnp.stack([jnp.sum(u * v, axis=-1, dtype=u.dtype) for u, v in pairs], axis=-1)

    c = jnp.clip(cosines(nodes_a, normals_a), -1.0, 1.0)
    d = jnp.clip(cosines(nodes_b, normals_b), -1.0, 1.0)
    # cos(alpha - beta) without arc cosines.
    cosine_of_gap = c * d + jnp.sqrt((1.0 - c * c) * (1.0 - d * d))
    return jnp.all(cosine_of_gap >= jnp.cos(angle_tolerance) - 1e-6, axis=-1)
