"""The maximum common subgraph of two sets of corners, by clique search or by the paper's backtracking."""

from collections.abc import Iterator
from typing import Literal

import equinox as eqx
import numpy as np
from jaxtyping import Int, Int32

from .._checks import InputError, check_choice, check_count
from .._results import RESULTS
from .._runtime.forks import refused_after_fork
from .._types import Array
from ..features.types import Corners
from .backtracking import MAX_BACKTRACKING_NODES, backtrack
from .cliques.maximum import MAX_CLIQUE_NODES, maximum_clique
from .consistency import DISTANCE_TOLERANCE, ConsistencyGraph, consistency_graph
from .early_transform import close_corners


class CommonSubgraph(eqx.Module):
    """Largest set of associations that agree with each other; reads as its (k, 2) array of associations.

    Attributes:
        associations: int32 (k, 2): rows of the corners of a and of b, in increasing order.
        ties: All largest sets that were found, `associations` first.
        completed: Whether the search ended inside its budget, so that no larger set exists.
        has_all_ties: Whether `ties` is complete.
        num_nodes: Nodes of the search tree that were visited.
        result: `too_few_associations` below three, `budget_exhausted`, or `successful`.
    """

    associations: Int32[np.ndarray, "k 2"]
    ties: tuple[np.ndarray, ...]
    completed: bool
    has_all_ties: bool
    num_nodes: int
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


@refused_after_fork
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
    max_nodes: int | None = None,
    max_seconds: float | None = None,
    max_ties: int = 64,
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
        min_distance: Pairs of corners nearer than this in either map [m] do not count as compatible.
        match_kinds: Whether only corners with equally many convex edges may match.
        associations: Candidates, or None for all pairs.
        early_transform: Backtracking only: with five matches, let their transform give the rest of the
            scheme.
        max_nodes: Budget of the search; None takes the default of the method.
        max_seconds: Clique only: budget of time [s], or None. Where it ends a search, the result depends on the
            machine.
        max_ties: Number of tied sets to keep.

    Returns:
        The associations with their ties; `RESULTS.budget_exhausted` if the budget was spent.

    Raises:
        InputError: If an argument cannot be used.

    References:
        Section IV.B-C.
    """
    check_choice("method", method, ("clique", "backtracking"))
    if method == "backtracking" and max_seconds is not None:
        raise InputError(
            f'max_seconds must be None with method="backtracking", got {max_seconds}; its budget is max_nodes.'
        )
    if max_nodes is not None:
        check_count("max_nodes", max_nodes)
    check_count("max_ties", max_ties)
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
        return subgraph_from_graph(graph, max_nodes=max_nodes, max_seconds=max_seconds, max_ties=max_ties)
    points = np.asarray(corners_a.position), np.asarray(corners_b.position)
    masks = np.asarray(corners_a.mask), np.asarray(corners_b.mask)
    extend = close_corners(*points, *masks, distance_tolerance) if early_transform else None
    count = graph.num_associations
    found = backtrack(
        np.asarray(graph.associations)[:count],
        graph.adjacency,
        extend=extend,
        max_nodes=MAX_BACKTRACKING_NODES if max_nodes is None else max_nodes,
        max_schemes=max_ties,
    )
    return _common_subgraph(found.schemes, found.completed, found.has_all_ties, found.num_nodes)


def subgraph_from_graph(
    graph: ConsistencyGraph,
    *,
    max_nodes: int | None = None,
    max_seconds: float | None = None,
    max_ties: int = 64,
) -> CommonSubgraph:
    """Maximum clique of a consistency graph that was made before, as associations.

    Args:
        graph: Graph that `consistency_graph` gave.
        max_nodes: Budget of the clique search, or None.
        max_seconds: Budget of time [s], or None.
        max_ties: Number of tied sets to keep; 1 saves the search for ties.
    """
    count = graph.num_associations
    # Padding rows come last and have no edges: the search need not see them.
    adjacency = np.asarray(graph.adjacency)[:count, :count]
    pairs = np.asarray(graph.associations)
    clique = maximum_clique(
        adjacency,
        max_nodes=MAX_CLIQUE_NODES if max_nodes is None else max_nodes,
        max_seconds=max_seconds,
        all_maximum=max_ties > 1,
        max_cliques=max_ties,
    )
    ties = tuple(pairs[members] for members in clique.ties)
    return _common_subgraph(ties, clique.completed, clique.has_all_ties, clique.num_nodes)


def _common_subgraph(
    ties: tuple[np.ndarray, ...], completed: bool, has_all_ties: bool, num_nodes: int
) -> CommonSubgraph:
    """Result with the code that fits: fewer than three associations fix no transform."""
    # Two matched points leave a turn about the line through them open.
    if len(ties[0]) < 3:
        result = RESULTS.too_few_associations
    else:
        result = RESULTS.successful if completed else RESULTS.budget_exhausted
    return CommonSubgraph(ties[0], ties, completed, has_all_ties, num_nodes, result)
