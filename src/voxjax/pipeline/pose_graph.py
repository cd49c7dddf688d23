"""Poses of many maps from registrations of their pairs: the best tree, the chained poses, what is left to disagree."""

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree

from .. import rigid
from ..grid import VoxelGrid
from ..metrics import pose_error
from ..registration.types import Registration
from .merged import LoopError


def spanning_tree(
    num_maps: int, pairs: Sequence[tuple[int, int, Registration]]
) -> list[tuple[int, int, Registration]]:
    """The edges of the best tree over the largest part of the maps that accepted pairs connect.

    Edges count by confidence, then by evidence, then by map numbers, so the result does not depend on the order
    of `pairs`. Of parts of equal size, the one with the lowest map number is returned.
    """
    # A pair that was not accepted is no edge, however well it scores: one wrong edge puts all maps behind it
    # wrong.
    accepted = [pair for pair in pairs if pair[2].accepted]
    accepted.sort(key=lambda pair: (-pair[2].confidence, -pair[2].best_score, pair[0], pair[1]))
    # An edge costs its place in that order: no two cost the same, so that there is one least tree.
    rank = {(a, b): number for number, (a, b, _) in enumerate(accepted)}
    rows, columns = np.asarray(list(rank), np.int32).reshape(-1, 2).T
    # Costs begin with 1, because a sparse tree drops edges that cost 0.
    costs = csr_array((np.arange(1.0, len(rank) + 1.0), (rows, columns)), shape=(num_maps, num_maps))
    _, part = connected_components(costs, directed=False)
    # Of the largest parts `argmax` takes the first, which holds the lowest map.
    size = np.bincount(part)[part]
    kept = minimum_spanning_tree(costs).tocoo()
    inside = part[kept.row] == part[np.argmax(size)]
    chosen = sorted(rank[int(a), int(b)] for a, b in zip(kept.row[inside], kept.col[inside], strict=True))
    return [accepted[number] for number in chosen]


def chain_poses(num_maps: int, tree: Sequence[tuple[int, int, Registration]]) -> list[np.ndarray | None]:
    """Poses `T_world_map` (4, 4) float64 of the maps in the tree; world is the frame of its lowest map."""
    poses: list[np.ndarray | None] = [None] * num_maps
    if not tree:
        return poses
    steps: dict[tuple[int, int], np.ndarray] = {}
    for a, b, registration in tree:
        T_a_b = np.asarray(registration.T_a_b, np.float64)
        steps[a, b], steps[b, a] = T_a_b, np.asarray(rigid.inverse(T_a_b))
    rows, columns = np.asarray(list(steps), np.int32).T
    edges = csr_array((np.ones(len(steps)), (rows, columns)), shape=(num_maps, num_maps))
    # Breadth first, each pose is a chain of as few pairs as the tree allows from the world's frame.
    order, before = breadth_first_order(edges, min(map(min, steps)))
    exact = {int(order[0]): np.eye(4)}
    for number in order[1:].tolist():
        previous = int(before[number])
        exact[number] = exact[previous] @ steps[previous, number]
    for number, pose in exact.items():
        poses[number] = pose
    return poses


def loop_errors(
    grids: Sequence[VoxelGrid],
    poses: Sequence[np.ndarray | None],
    pairs: Sequence[tuple[int, int, Registration]],
    tree: Sequence[tuple[int, int, Registration]],
) -> list[LoopError]:
    """How far each accepted pair outside the tree disagrees with the chained poses."""
    in_tree = {(a, b) for a, b, _ in tree}
    errors = []
    for a, b, registration in pairs:
        pose_a, pose_b = poses[a], poses[b]
        if not registration.accepted or (a, b) in in_tree or pose_a is None or pose_b is None:
            continue
        chained = rigid.inverse(pose_a) @ pose_b
        direct = np.asarray(registration.T_a_b, np.float64)
        # The error is taken where map b is, not at its origin, which may lie far from it.
        low, high = grids[b].extent
        error = pose_error(chained, direct, (low + high) / 2.0)
        errors.append(LoopError(a=a, b=b, metres=error.metres, radians=float(np.radians(error.degrees))))
    return errors
