"""Associations that can hold together: distances (equation 4), angles between frames, one-to-one.

The distances of all pairs of associations are one dense mask on the device; angles are looked at only where
the distances agree. Memory: one byte a pair of rows, padding included (`graph_memory`).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int, Int32

from .._checks import InputError, check_positive, shown
from .._runtime.buckets import pad_rows, wide_bucket_size
from .._runtime.forks import refused_after_fork
from .._runtime.memory import check_memory
from .._runtime.pieces import one_by_one, over_pieces
from .._types import Array
from ..features.types import Corners
from .associations import all_associations, check_associations, same_kind
from .compatibility import distance_consistency, normals_agree, rotations_agree

DISTANCE_TOLERANCE = 0.2
"""D of equation (4) [m]: two voxels of a map of 10 cm, which is what two roundings and a little drift amount to."""

MAX_ASSOCIATIONS = 32768
"""More would take over a gigabyte; choose candidates first. No list is padded to more either: the next step of the
ladder would take four times as much for the same associations."""


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


@refused_after_fork
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
        InputError: If a tolerance is not positive, an index does not exist, there are too many associations, or their
            graph needs more memory than there is.

    References:
        Section IV.B-C, equation (4).
    """
    for name, corners in (("corners_a", corners_a), ("corners_b", corners_b)):
        if not isinstance(corners, Corners):
            raise InputError(f"{name} must be Corners, as detect_corners gives them, got {shown(corners)}.")
    if associations is None:
        associations = all_associations(corners_a.mask, corners_b.mask)
    if match_kinds:
        associations = same_kind(associations, corners_a.convexity, corners_b.convexity)
    pairs = check_associations(associations, len(corners_a.mask), len(corners_b.mask))
    adjacency = pairwise_consistency(
        corners_a.position,
        corners_b.position,
        pairs,
        distance_tolerance=distance_tolerance,
        min_distance=min_distance,
        angle_tolerance=angle_tolerance,
        frames_a=corners_a.normals if angle_tolerance is not None else None,
        frames_b=corners_b.normals if angle_tolerance is not None else None,
    )
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
        min_distance: Pairs of points nearer than this in either map [m] are not compatible.
        angle_tolerance: Largest difference of angles [rad], used with frames or normals.
        frames_a: Rows are three unit normals, in a cyclic order that is not known.
        frames_b: Frames of b, alike.
        normals_a: One unit normal a point: the three angles between two normals and the line through their
            points must agree in a and b.
        normals_b: Unit normals of b.

    Returns:
        bool (m, m) on the host, m the bucket of the number of associations; False in padding.

    Raises:
        InputError: If a tolerance is not positive, an index does not exist, there are too many associations, or their
            graph needs more memory than there is.
    """
    check_positive("distance_tolerance", distance_tolerance, "m")
    if min_distance != 0:
        check_positive("min_distance", min_distance, "m")
    pairs = check_associations(associations, len(points_a), len(points_b))
    if len(pairs) > MAX_ASSOCIATIONS:
        raise InputError(
            f"associations must be at most {MAX_ASSOCIATIONS}, got {len(pairs)}; give fewer candidates."
        )
    if angle_tolerance is not None:
        check_positive("angle_tolerance", angle_tolerance, "rad")
    has_angles = angle_tolerance is not None and (frames_a is not None or normals_a is not None)
    check_memory(
        graph_memory(len(pairs), has_angles=has_angles),
        f"a consistency graph of {len(pairs)} associations",
        "give fewer candidates",
    )
    size = _padded_size(len(pairs))
    # Points are gathered on the host, so that the kernel sees one shape whatever the numbers of corners are.
    nodes = [
        _places(name, points, pairs[:, side], size)
        for side, (name, points) in enumerate(zip("ab", (points_a, points_b), strict=True))
    ]
    adjacency = np.asarray(
        distance_consistency(
            *nodes, pad_rows(pairs, size, -1.0), np.float32(distance_tolerance), np.float32(min_distance)
        )
    )
    if angle_tolerance is None or not has_angles:
        return adjacency
    tolerance = np.float32(angle_tolerance)
    # What JAX gives cannot be written to.
    adjacency = adjacency.copy()
    for given_a, given_b, test in (
        (frames_a, frames_b, rotations_agree),
        (normals_a, normals_b, normals_agree),
    ):
        if given_a is not None and given_b is not None:
            more = [_gather(g, pairs[:, side], size) for side, g in enumerate((given_a, given_b))]
            _keep_edges(adjacency, lambda edges, more=more, test=test: test(*nodes, *more, edges, tolerance))
    return adjacency


def graph_memory(count: int, *, has_angles: bool) -> float:
    """Memory that the graph of `count` associations takes at its peak [byte], but for the list of its edges.

    Args:
        count: Number of associations.
        has_angles: Whether angles are looked at after the distances.
    """
    # The mask; for the angles also a copy that can be written to, its upper triangle, and what selects that.
    return float(_padded_size(count)) ** 2 * (4.0 if has_angles else 1.0)


def _padded_size(count: int) -> int:
    """Rows of the graph of `count` associations, padding included."""
    return min(wide_bucket_size(count, 256), MAX_ASSOCIATIONS)


def _places(name: str, points: Array, index: np.ndarray, size: int) -> np.ndarray:
    """Points of the associations about their mean, float32, padded; only differences of them are looked at."""
    places = np.asarray(points, np.float64)[index]
    # NaN would fail every comparison in silence, and its corner would just never match.
    if not np.isfinite(places).all():
        raise InputError(f"associations must index points with finite places, got NaN or infinity in {name}.")
    if len(places):
        places -= places.mean(axis=0)
    return pad_rows(places.astype(np.float32), size)


def _gather(rows: Array, index: np.ndarray, size: int) -> np.ndarray:
    """Rows of the associations on the host, float32, padded."""
    return pad_rows(np.asarray(rows, np.float32)[index], size)


def _keep_edges(adjacency: np.ndarray, agree) -> None:
    """Clear, in place, the edges that `agree` rejects; asks in chunks of one fixed shape."""
    # One chunk after the other: what one writes down in between is many times as large as its edges.
    edge_chunk = 1 << 18
    # Row and column of each edge, once as NumPy lists them and once as the kernel takes them, and what is rejected.
    num_edges = np.count_nonzero(adjacency) // 2
    check_memory(32.0 * num_edges, f"a consistency graph of {num_edges} edges", "give fewer candidates")
    # The angles are symmetric: half of the edges tell all.
    edges = np.argwhere(np.triu(adjacency)).astype(np.int32)
    if len(edges) == 0:
        return
    is_kept = over_pieces(lambda chunk, _: agree(chunk), [edges], size=edge_chunk, run=one_by_one)
    i, j = edges[~is_kept].T
    # Edges were listed with the smaller row first; the graph has both directions.
    adjacency[i, j] = False
    adjacency[j, i] = False
