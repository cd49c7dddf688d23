"""Contradictions by structure: what stands in one map where the other one saw free space, apart from drift.

Drift moves walls by some voxels and scatters conflicts along all surfaces; these lie beside a parallel surface of the
other map. A wrong storey of one plan, or changes between two days, leave the walls alone and set whole things into free
space: pieces that hang together, away from what is parallel to them, among the surface that is no wall, floor or
ceiling. Their share of that surface tells a few moved chairs from other furniture.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ... import rigid
from ..._runtime.threads import spread
from ...maps.prepared import FIELD_RADIUS, PreparedMap
from ...ops.evidence.nearest import split_keys
from ...ops.evidence.scoring import CONFLICT, HIT
from ..hypotheses.kept import kept_of_pair
from ..hypotheses.map_features import MapFeatures
from .pieces import cells_of_points, pieces_of
from .settings import VerdictConfig
from .structure import lies_on_structure


class Piece(NamedTuple):
    """Surface of one map that hangs together, in free space of the other.

    Attributes:
        occupied_in: Map whose surface it is, "a" or "b".
        area: Its surface [m^2].
        low: Least corner of the box around it, in frame a [m].
        high: Greatest corner of the box [m].
    """

    occupied_in: str
    area: float
    low: tuple[float, float, float]
    high: tuple[float, float, float]


class Contradictions(NamedTuple):
    """What contradicts a pose, of both maps.

    Attributes:
        share: Area of the pieces, as a share of them and of all agreeing surface that is no wall, floor or ceiling.
        agreeing: All surface that agrees [m^2].
        conflicting: All surface in free space of the other map that hangs together, walls and drift included [m^2].
        pieces: The pieces, largest first.
    """

    share: float
    agreeing: float
    conflicting: float
    pieces: tuple[Piece, ...]

    @property
    def area(self) -> float:
        """Area of the pieces [m^2]."""
        return float(sum(piece.area for piece in self.pieces))


def find_contradictions(
    a: MapFeatures, b: MapFeatures, T_a_b: np.ndarray, settings: VerdictConfig | None = None
) -> Contradictions:
    """Pieces of either map in free space of the other, beyond what drift explains; found once for each pose.

    Args:
        a: First map.
        b: Second map.
        T_a_b: Pose (4, 4) between the local frames of the features.
        settings: How large a piece and a wall are.
    """
    settings = VerdictConfig() if settings is None else settings
    T = np.asarray(T_a_b, np.float64)
    # Rivals are looked at in each round, and the first pose once more for the report.
    key = ("contradictions", T.tobytes(), settings)
    return kept_of_pair(a, b, key, partial(_find, a, b, T, settings))


def _find(
    a: MapFeatures, b: MapFeatures, T: Float[np.ndarray, "4 4"], settings: VerdictConfig
) -> Contradictions:
    """`find_contradictions`, whether anything is kept or not."""
    one = partial(lies_on_structure, min_share=settings.min_structure_share)
    key = ("structures", settings.min_structure_share)
    is_in_a, is_in_b = kept_of_pair(a, b, key, lambda: spread(one, (a, b)))
    ways = [(a, b, T, is_in_b), (b, a, np.asarray(rigid.inverse(T)), is_in_a)]
    found = spread(lambda way: _one_way(*way, settings=settings), ways)
    pieces = []
    for name, (*_, parts) in zip("ba", found, strict=True):
        for area, points in parts:
            # Boxes of both maps are in one frame, so that a person finds them in one picture.
            in_a = points @ T[:3, :3].T + T[:3, 3] if name == "b" else points
            in_a = in_a + a.origin
            pieces.append(
                Piece(name, area, tuple(in_a.min(axis=0).tolist()), tuple(in_a.max(axis=0).tolist()))
            )
    pieces.sort(key=lambda piece: -piece.area)
    in_pieces = sum(piece.area for piece in pieces)
    agreeing, loose, conflicting = np.sum([way[:3] for way in found], axis=0).tolist()
    return Contradictions(in_pieces / max(in_pieces + loose, 1e-12), agreeing, conflicting, tuple(pieces))


def _one_way(
    target: MapFeatures,
    other: MapFeatures,
    T: np.ndarray,
    is_structure: Bool[np.ndarray, "n"],
    *,
    settings: VerdictConfig,
) -> tuple[float, float, float, list[tuple[float, np.ndarray]]]:
    """Of the surface of `other` [m^2] what agrees, what of that is no wall, and what conflicts; and its pieces.

    Args:
        target: The map that is looked into.
        other: The map whose voxels look.
        T: Pose (4, 4) of `other` in `target`.
        is_structure: Which voxels of `other` lie on walls, floors and ceilings.
        settings: How large a piece is.

    Returns:
        The three areas, and area and voxel centres of each piece.
    """
    into, of = target.prepared, other.prepared
    points = np.asarray(of.points)[: of.num_points]
    cell, is_inside = cells_of_points(into, points, T)
    code = np.take(np.asarray(into.codes), cell) * is_inside
    face = of.grid.voxel_size**2
    is_hit, is_conflict = code == HIT, code == CONFLICT
    agreeing, loose = (float(np.count_nonzero(rows)) * face for rows in (is_hit, is_hit & ~is_structure))
    in_piece = _in_pieces(of, points[is_conflict], settings.min_piece_voxels)
    conflicting = float(np.count_nonzero(in_piece >= 0)) * face
    suspect = np.flatnonzero(is_conflict & ~is_structure)
    suspect = suspect[~_is_drift(into, of, suspect, cell[suspect], T)]
    in_piece = _in_pieces(of, points[suspect], settings.min_piece_voxels)
    parts = [points[suspect[in_piece == number]] for number in np.unique(in_piece[in_piece >= 0])]
    return agreeing, loose, conflicting, [(len(part) * face, part.astype(np.float64)) for part in parts]


def _in_pieces(prepared: PreparedMap, points: Float[np.ndarray, "n 3"], least: int) -> Int[np.ndarray, "n"]:
    """Number of the piece that each of some voxels is in, -1 for those in pieces of less than `least` voxels."""
    if len(points) == 0:
        return np.zeros(0, np.int64)
    index = np.floor((points - prepared.grid.origin) / prepared.grid.voxel_size).astype(np.int64)
    piece = pieces_of(index).astype(np.int64)
    return np.where(np.bincount(piece)[piece] >= least, piece, -1)


def _is_drift(
    into: PreparedMap, of: PreparedMap, rows: Int[np.ndarray, "n"], cell: Int[np.ndarray, "n"], T: np.ndarray
) -> Bool[np.ndarray, "n"]:
    """Whether each of some voxels lies beside a parallel surface of the other map: drift puts it there.

    Args:
        into: The map that is looked into.
        of: The map whose voxels they are.
        rows: The voxels.
        cell: Cells of the pools of `into` that they fall into.
        T: Pose (4, 4) of `of` in `into`.
    """
    row, squared = (np.asarray(part) for part in split_keys(np.take(np.asarray(into.keys), cell)))
    is_near = squared <= FIELD_RADIUS**2
    # Without a voxel in reach any row would do: it is not looked at.
    met = np.asarray(into.normals)[np.where(is_near, row, 0)]
    turned = np.asarray(of.normals)[rows] @ T[:3, :3].T.astype(np.float32)
    # Normals of single voxels are biased by the grid, by up to some 20 degrees.
    return is_near & (np.abs(np.einsum("ni,ni->n", turned, met)) > 0.8)
