"""Conflicts that hang together: what a false pose among equal rooms shows, and the true one does not.

Drift, noise and people scatter conflicts; a pose that is wrong by a whole room sets whole pieces of furniture into
free space.
"""

from functools import partial

import numpy as np
from jaxtyping import Int
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from ... import rigid
from ..._runtime.threads import spread
from ...maps.prepared import PreparedMap
from ...ops.evidence.lookup import cells_on_host, turned_on_host
from ...ops.evidence.scoring import CONFLICT, HIT
from .judgement import Judgement
from .leaders import Leaders
from .settings import VerdictConfig


def piece_area(
    a: PreparedMap, b: PreparedMap, T_a_b: np.ndarray, *, min_area: float = VerdictConfig.min_piece_area
) -> tuple[float, float]:
    """Surface in connected conflicts, and surface that agrees, of both maps together [m^2].

    Args:
        a: First map.
        b: Second map.
        T_a_b: Pose (4, 4).
        min_area: Conflicts that hang together count from so much surface on [m^2].
    """
    in_pieces = num_hits = 0
    for target, other, T in ((a, b, T_a_b), (b, a, np.asarray(rigid.inverse(T_a_b)))):
        points = np.asarray(other.points)[: other.num_points]
        code = _codes_at(target, points, T)
        num_hits += int(np.count_nonzero(code == HIT))
        in_pieces += _in_pieces(other, points[code == CONFLICT], min_area)
    # A voxel of a surface stands for one face of it.
    face = a.grid.voxel_size**2
    return in_pieces * face, num_hits * face


def _codes_at(target: PreparedMap, points: np.ndarray, T: np.ndarray) -> np.ndarray:
    """Evidence codes where a pose puts points (n, 3) [m]; 0 outside."""
    voxel = target.grid.voxel_size
    # Divided in float64, so that float32 rounds once.
    turn = (T[:3, :3].astype(np.float64) / voxel).astype(np.float32)
    shift = ((T[:3, 3].astype(np.float64) - target.grid.origin) / voxel).astype(np.float32)
    turned = turned_on_host(turn, np.ascontiguousarray(points.T))
    places = (np.add(place, shift[axis], out=place) for axis, place in enumerate(turned))
    cell, is_inside = cells_on_host(places, target.grid.shape, np.asarray(target.table))
    # Places outside were given cell 0, whose code means nothing there.
    return np.take(np.asarray(target.codes), cell) * is_inside


def _in_pieces(other: PreparedMap, points: np.ndarray, min_area: float) -> int:
    """How many of the occupied voxels at `points` are connected to pieces that are large enough."""
    if len(points) == 0:
        return 0
    voxel = other.grid.voxel_size
    index = np.floor((points - other.grid.origin) / voxel).astype(np.int64)
    sizes = np.bincount(_pieces(index))
    return int(sizes[sizes * voxel**2 >= min_area].sum())


def _pieces(index: Int[np.ndarray, "n 3"], *, most: int = 1 << 24) -> Int[np.ndarray, "n"]:
    """Number of the piece that each of some voxels belongs to; they hang together across edges and corners, too.

    Args:
        index: Different voxels; slanted surfaces are steps of them, which share no more than edges and corners.
        most: Voxels of a box around all of them that is labelled as a whole.
    """
    # The box around the conflicts alone is labelled, not the whole map.
    index = index - index.min(axis=0)
    shape = index.max(axis=0) + 1
    if shape.astype(np.float64).prod() <= most:
        block = np.zeros(shape, bool)
        block[tuple(index.T)] = True
        labels = np.empty(block.shape, np.int32)
        ndimage.label(block, np.ones((3, 3, 3), int), output=labels)
        return labels[tuple(index.T)]
    # Centres of neighbours across a corner are the root of 3 apart, those of the next voxels 2.
    pairs = KDTree(index).query_pairs(1.9, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), bool), tuple(pairs.T)), shape=(len(index), len(index)))
    return connected_components(graph, directed=False)[1]


def weigh_pieces(a: PreparedMap, b: PreparedMap, leaders: Leaders, settings: VerdictConfig) -> Leaders:
    """Leaders with the pieces of the rivals for the first place, best first by the score net of them.

    Args:
        a: First map.
        b: Second map.
        leaders: Distinct poses, judged.
        settings: Which poses are rivals, and how large a piece is.
    """
    # Pieces decide between rivals alone, and looking for them passes over all voxels of both maps.
    is_rival = rivals(leaders.judgement, settings.min_rival_share)
    areas = np.zeros((len(leaders.poses), 2))
    if is_rival.any():
        area = partial(piece_area, a, b, min_area=settings.min_piece_area)
        areas[is_rival] = spread(area, leaders.poses[is_rival])
    pieces, shared = areas.T
    judgement = leaders.judgement._replace(pieces=pieces, shared=shared)
    order = np.argsort(-net_scores(judgement, settings), kind="stable")
    # The best pose is the first one everywhere after this: the verdict and the last refinement take it from
    # there.
    return leaders._replace(judgement=judgement).take(order)


def rivals(judgement: Judgement, min_share: float = VerdictConfig.min_rival_share) -> np.ndarray:
    """Whether each pose (k,) competes for the first place: the best one, and those with a share of its score."""
    scores = judgement.score()
    # A pose without a positive score is supported by nothing, and no rival of anything.
    return (scores >= min_share * scores.max(initial=0.0)) & (scores > 0.0)


def net_scores(judgement: Judgement, settings: VerdictConfig | None = None) -> np.ndarray:
    """Scores (k,); those of rivals fall with the area of their pieces, and the cleanest one keeps its score.

    Pieces that all rivals show, from drift or moved things, tell nothing between them.

    Args:
        judgement: The poses, judged, with the pieces of the rivals.
        settings: Which poses are rivals, and how large a piece is.
    """
    settings = VerdictConfig() if settings is None else settings
    is_rival = rivals(judgement, settings.min_rival_share)
    least = judgement.pieces[is_rival].min(initial=np.inf)
    # The area from which pieces count keeps the quotient finite, and lets small differences weigh little.
    area = max(settings.min_piece_area, 1e-12)
    return judgement.score() * np.where(is_rival, (area + least) / (area + judgement.pieces), 1.0)
