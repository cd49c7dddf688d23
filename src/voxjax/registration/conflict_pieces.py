"""Conflicts that hang together: what a false pose among equal rooms shows, and the true one does not.

Drift, noise and people scatter conflicts; a pose that is wrong by a whole room sets whole pieces of furniture into
free space (DESIGN.md 3.5).
"""

import numpy as np
from scipy import ndimage

from ..ops.evidence import CONFLICT, HIT
from .leaders import Judgement, Leaders, inverse_poses
from .prepared import PreparedMap

MIN_AREA = 1.5
"""A piece begins at so much surface [m^2]: a closed door, found open by the other robot, has about that."""

PIECE_WEIGHT = 200.0
"""One per cent of the hits in pieces beyond those of the cleanest rival costs a factor of exp(-2); fitted together with
the model of `registration/verdict.py`."""

MIN_SHARE = 0.5
"""Poses with less than this share of the best score are no rivals, and are not looked at."""


def piece_share(a: PreparedMap, b: PreparedMap, T_a_b: np.ndarray) -> float:
    """Voxels of both maps in connected conflicts of at least `MIN_AREA`, as a share of those that hit.

    Args:
        a: First map.
        b: Second map.
        T_a_b: Pose (4, 4).
    """
    in_pieces = num_hits = 0
    for target, other, T in ((a, b, T_a_b), (b, a, inverse_poses(T_a_b[None])[0])):
        points = np.asarray(other.points)[: other.num_points]
        code = _codes_at(target, points @ T[:3, :3].T + T[:3, 3])
        num_hits += int(np.count_nonzero(code == HIT))
        in_pieces += _in_pieces(other, points[code == CONFLICT])
    return in_pieces / max(num_hits, 1)


def _codes_at(target: PreparedMap, points: np.ndarray) -> np.ndarray:
    """Evidence codes at points (n, 3) [m]; 0 outside."""
    shape = np.asarray(target.grid.states.shape)
    cell = np.floor((points - target.grid.origin) / target.grid.voxel_size).astype(np.int64)
    is_inside = ((cell >= 0) & (cell < shape)).all(axis=1)
    flat = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
    return np.where(is_inside, np.asarray(target.codes)[np.where(is_inside, flat, 0)], 0)


def _in_pieces(other: PreparedMap, points: np.ndarray) -> int:
    """How many of the occupied voxels at `points` are connected to pieces that are large enough."""
    if len(points) == 0:
        return 0
    voxel = other.grid.voxel_size
    index = np.floor((points - other.grid.origin) / voxel).astype(np.int64)
    index -= index.min(axis=0)
    block = np.zeros(index.max(axis=0) + 1, bool)
    block[tuple(index.T)] = True
    labels = np.empty(block.shape, np.int32)
    ndimage.label(block, np.ones((3, 3, 3), int), output=labels)
    sizes = np.bincount(labels[block])
    return int(sizes[sizes * voxel**2 >= MIN_AREA].sum())


def weigh_pieces(a: PreparedMap, b: PreparedMap, leaders: Leaders) -> tuple[Leaders, np.ndarray]:
    """Leaders with the pieces of the rivals for the first place, best first by the evidence net of them.

    Returns:
        Leaders, and their rows among those given.
    """
    is_rival = rivals(leaders.judgement)
    pieces = np.asarray(
        [piece_share(a, b, T) if wanted else 0.0 for T, wanted in zip(leaders.poses, is_rival, strict=True)]
    )
    judgement = leaders.judgement._replace(pieces=pieces)
    order = np.argsort(-evidence(judgement), kind="stable")
    ranked = Leaders(
        leaders.poses[order], Judgement(*(part[order] for part in judgement)), leaders.rows[order]
    )
    return ranked, order


def rivals(judgement: Judgement) -> np.ndarray:
    """Which poses (k,) compete for the first place, the best included."""
    scores = judgement.score()
    return (scores >= MIN_SHARE * scores.max(initial=0.0)) & (scores > 0.0)


def evidence(judgement: Judgement) -> np.ndarray:
    """Scores (k,), those of rivals less what their pieces exceed those of the cleanest one by.

    Pieces that all rivals show, from drift or moved things, tell nothing between them.
    """
    is_rival = rivals(judgement)
    extra = judgement.pieces - judgement.pieces[is_rival].min(initial=np.inf)
    return judgement.score() * np.exp(-PIECE_WEIGHT * np.where(is_rival, extra, 0.0))
