"""Isolated far pieces of a dense map: found, remarked, and left out on request."""

from ..grid import VoxelGrid
from ..maps.findings import Remark, isolated_remark, units_remark
from ..maps.isolated import IsolatedPieces, isolated_pieces
from ..maps.main_part import without_pieces


def without_strays(grid: VoxelGrid, *, is_dropped: bool) -> tuple[VoxelGrid, list[Remark]]:
    """Look for isolated pieces of a map, and for what its lengths hint at.

    Args:
        grid: The map.
        is_dropped: Whether isolated pieces are left out.

    Returns:
        The map, the given one if nothing is left out, and remarks about pieces and units.

    Raises:
        InputError: If there is not enough memory for the list of occupied voxels.
    """
    index = grid.occupied_index()
    if not len(index):
        return grid, []
    pieces = isolated_pieces(index)
    kept = without_pieces(grid, index, pieces) if is_dropped and len(pieces.distance) else grid
    size = grid.voxel_size
    pieces = pieces._replace(distance=pieces.distance * size, sides=pieces.sides * size, voxel_size=size)
    return kept, piece_remarks(pieces, size, is_dropped=is_dropped)


def piece_remarks(pieces: IsolatedPieces, spacing: float, *, is_dropped: bool) -> list[Remark]:
    """What the isolated pieces of a map, and the lengths of its main part, give to say.

    Args:
        pieces: What was found, in metres.
        spacing: Voxel size, or how far apart the points of a cloud lie [m].
        is_dropped: Whether isolated pieces are left out.
    """
    remarks = [isolated_remark(pieces, is_dropped=is_dropped), units_remark(spacing, pieces.sides)]
    return [remark for remark in remarks if remark is not None]
