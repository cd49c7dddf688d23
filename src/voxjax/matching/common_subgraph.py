"""The maximum common subgraph of two sets of corners, by clique search or by the paper's backtracking."""

from collections.abc import Callable, Iterator
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int, Int32
from scipy.spatial import KDTree

from .. import rigid
from .._checks import InputError, check_choice
from .._results import RESULTS
from .._types import Array
from ..features.types import Corners
from .backtracking import MAX_SEARCH_NODES as MAX_BACKTRACKING_NODES
from .backtracking import Extend, backtrack
from .cliques.maximum import MAX_SEARCH_NODES as MAX_CLIQUE_NODES
from .cliques.maximum import maximum_clique
from .cliques.weighted import maximum_weight_clique
from .consistency import DISTANCE_TOLERANCE, ConsistencyGraph, consistency_graph

Align = Callable[[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]], Float[np.ndarray, "4 4"]]
"""Transform `T_a_b` of matched points (of a, of b)."""


class CommonSubgraph(eqx.Module):
    """Largest set of associations that agree with each other; reads as its (k, 2) array of associations.

    Attributes:
        associations: int32 (k, 2): rows of the corners of a and of b, in increasing order.
        ties: All largest sets that were found, `associations` first.
        completed: Whether the search ended inside its budget, so that no larger set exists.
        has_all_ties: Whether `ties` is complete.
        num_nodes: Nodes of the search tree that were visited.
        near_ties: Sets smaller by `slack` associations at most that no other association extends, largest first.
        has_all_near_ties: Whether `near_ties` is complete.
        weight: Sum of the associations' weights; their number where none were given.
        result: `too_few_associations` below three, `budget_exhausted`, or `successful`.
    """

    associations: Int32[np.ndarray, "k 2"]
    ties: tuple[np.ndarray, ...]
    completed: bool
    has_all_ties: bool
    num_nodes: int
    near_ties: tuple[np.ndarray, ...]
    has_all_near_ties: bool
    weight: float
    result: RESULTS

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the associations."""
        return self.associations.shape

    def __len__(self) -> int:
        """Number of associations."""
        return len(self.associations)

    def __iter__(self) -> Iterator[np.ndarray]:
        """The associations, one by one."""
        return iter(self.associations)

    def __getitem__(self, index: object) -> np.ndarray:
        """Part of the associations."""
        return self.associations[index]  # pyright: ignore[reportArgumentType, reportCallIssue]

    def __array__(self, dtype: object = None, copy: bool | None = None) -> np.ndarray:
        """The associations as an array."""
        return np.array(self.associations, dtype=dtype, copy=copy)  # pyright: ignore


def maximum_common_subgraph(
    corners_a: Corners,
    corners_b: Corners,
    *,
    distance_tolerance: float = DISTANCE_TOLERANCE,
    method: Literal["clique", "backtracking"] = "clique",
    angle_tolerance: float | None = None,
    min_distance: float = 0.0,
    match_kinds: bool = False,
    associations: Int[Array, "k 2"] | None = None,
    early_transform: bool = False,
    align: Align | None = None,
    max_nodes: int | None = None,
    max_seconds: float | None = None,
    max_ties: int = 64,
    slack: int = 0,
    weights: Float[Array, "w"] | None = None,
) -> CommonSubgraph:
    """Most associations of corners whose distances all agree, with every corner used once at most.

    Both methods are exact (without the early transform) and give the same size.

    Args:
        corners_a: Corners of map a.
        corners_b: Corners of map b.
        distance_tolerance: D of equation (4) [m]; two voxels of a map of 10 cm unless given.
        method: "clique": branch and bound on the association graph; "backtracking": Algorithm 1 as in the
            paper.
        angle_tolerance: If given [rad], frames of corners must agree too, see `consistency_graph`.
        min_distance: See `consistency_graph` [m].
        match_kinds: See `consistency_graph`.
        associations: Candidates, or None for all pairs.
        early_transform: Backtracking only: with five matches, let their transform give the rest of the
            scheme.
        align: Transform of matched corners for it; None aligns the corners alone.
        max_nodes: Budget of the search; None takes the default of the method.
        max_seconds: Clique only: budget of time [s], or None. Where it ends a search, the result depends on the
            machine.
        max_ties: Number of tied sets to keep, and of near-ties.
        slack: Clique only: also list sets that are smaller by so many associations at most.
        weights: Clique only: a positive weight for each of the given associations; the set of the largest sum is
            wanted then, and its ties are not listed.

    Returns:
        The associations with their ties; `RESULTS.budget_exhausted` if the budget was spent.

    Raises:
        InputError: If an argument cannot be used.

    References:
        Section IV.B-C.
    """
    check_choice("method", method, ("clique", "backtracking"))
    if method == "backtracking" and (slack or max_seconds is not None or weights is not None):
        raise InputError('slack, max_seconds and weights need method="clique".')
    if weights is not None and (associations is None or len(weights) != len(associations)):
        raise InputError("weights need `associations`, one weight for each of them.")
    if weights is not None and match_kinds:
        raise InputError(
            "weights and match_kinds exclude each other; leave out associations of other kinds yourself."
        )
    graph = consistency_graph(
        corners_a,
        corners_b,
        distance_tolerance=distance_tolerance,
        angle_tolerance=angle_tolerance,
        min_distance=min_distance,
        match_kinds=match_kinds,
        associations=associations,
    )
    if method == "clique":
        return subgraph_from_graph(
            graph,
            max_nodes=max_nodes,
            max_seconds=max_seconds,
            max_ties=max_ties,
            slack=slack,
            weights=weights,
        )
    points = np.asarray(corners_a.position), np.asarray(corners_b.position)
    masks = np.asarray(corners_a.mask), np.asarray(corners_b.mask)
    extend = close_corners(*points, *masks, distance_tolerance, align) if early_transform else None
    count = graph.num_associations
    found = backtrack(
        np.asarray(graph.associations)[:count],
        graph.adjacency,
        extend=extend,
        max_nodes=MAX_BACKTRACKING_NODES if max_nodes is None else max_nodes,
        max_schemes=max_ties,
    )
    size = float(len(found.schemes[0]))
    return _common_subgraph(found.schemes, found.completed, found.has_all_ties, found.num_nodes, size)


def subgraph_from_graph(
    graph: ConsistencyGraph,
    *,
    max_nodes: int | None = None,
    max_seconds: float | None = None,
    max_ties: int = 64,
    slack: int = 0,
    weights: Float[Array, "w"] | None = None,
) -> CommonSubgraph:
    """Maximum clique of a consistency graph that was made before, as associations.

    Args:
        graph: From `consistency_graph`.
        max_nodes: Budget of the clique search, or None.
        max_seconds: Budget of time [s], or None.
        max_ties: Number of tied sets to keep; 1 saves the search for ties.
        slack: Also list sets that are smaller by so many associations at most.
        weights: Weight of each association, positive; None counts them. Ties are not listed with weights.
    """
    count = graph.num_associations
    adjacency = np.asarray(graph.adjacency)[:count, :count]
    pairs = np.asarray(graph.associations)
    limit = MAX_CLIQUE_NODES if max_nodes is None else max_nodes
    if weights is not None:
        heavy = maximum_weight_clique(
            adjacency, np.asarray(weights), max_nodes=limit, max_seconds=max_seconds
        )
        return _common_subgraph(
            (pairs[heavy.members],), heavy.completed, False, heavy.num_nodes, heavy.weight
        )
    clique = maximum_clique(
        adjacency, max_nodes=limit, max_seconds=max_seconds, all_maximum=max_ties > 1, slack=slack,
        max_cliques=max_ties,
    )  # fmt: skip
    ties, near = (tuple(pairs[members] for members in some) for some in (clique.ties, clique.near_ties))
    return _common_subgraph(
        ties, clique.completed, clique.has_all_ties, clique.num_nodes, float(len(clique.members)), near,
        clique.has_all_near_ties,
    )  # fmt: skip


def _common_subgraph(
    ties: tuple[np.ndarray, ...], completed: bool, has_all_ties: bool, num_nodes: int, weight: float,
    near_ties: tuple[np.ndarray, ...] = (), has_all_near_ties: bool = True,
) -> CommonSubgraph:  # fmt: skip
    """Result with the code that fits."""
    if len(ties[0]) < 3:
        result = RESULTS.too_few_associations
    else:
        result = RESULTS.successful if completed else RESULTS.budget_exhausted
    return CommonSubgraph(
        ties[0], ties, completed, has_all_ties, num_nodes, near_ties, has_all_near_ties, weight, result
    )


def close_corners(
    points_a: np.ndarray,
    points_b: np.ndarray,
    mask_a: np.ndarray,
    mask_b: np.ndarray,
    distance_tolerance: float,
    align: Align | None = None,
) -> Extend:
    """The early transform of section IV.C, as a function from a few matches to a whole scheme.

    The transform of the matches carries the corners of b into a; those that come nearer than the tolerance to
    a corner of a, each being the nearest of the other, join the matches.

    Args:
        points_a: float32 (n, 3) [m].
        points_b: float32 (m, 3) [m].
        mask_a: Which rows count.
        mask_b: Which rows count.
        distance_tolerance: [m].
        align: How to get the transform of matched corners; None aligns them alone.
    """
    rows_a, rows_b = np.flatnonzero(mask_a), np.flatnonzero(mask_b)
    corners_a, corners_b = points_a[rows_a].astype(np.float64), points_b[rows_b].astype(np.float64)
    tree_a = KDTree(corners_a)
    solve = kabsch if align is None else align

    def extend(matches: np.ndarray) -> np.ndarray:
        T_a_b = np.asarray(solve(points_a[matches[:, 0]], points_b[matches[:, 1]]), np.float64)
        moved = corners_b @ T_a_b[:3, :3].T + T_a_b[:3, 3]
        distance, nearest = map(np.asarray, tree_a.query(moved, distance_upper_bound=distance_tolerance))
        scheme = {int(i): int(j) for i, j in matches}
        taken = set(scheme.values())
        for k in np.argsort(distance, kind="stable"):
            if not np.isfinite(distance[k]):
                break
            i, j = int(rows_a[nearest[k]]), int(rows_b[k])
            if i not in scheme and j not in taken:
                scheme[i] = j
                taken.add(j)
        return np.asarray(sorted(scheme.items()), np.int32)

    return extend


def kabsch(points_a: np.ndarray, points_b: np.ndarray) -> np.ndarray:
    """`T_a_b` of matched points on the host, float64 (4, 4): thousands of tiny problems inside a search."""
    points_a, points_b = points_a.astype(np.float64), points_b.astype(np.float64)
    mean_a, mean_b = points_a.mean(axis=0), points_b.mean(axis=0)
    T_a_b = np.eye(4)
    T_a_b[:3, :3] = rigid.nearest_rotation((points_a - mean_a).T @ (points_b - mean_b))
    T_a_b[:3, 3] = mean_a - T_a_b[:3, :3] @ mean_b
    return T_a_b
