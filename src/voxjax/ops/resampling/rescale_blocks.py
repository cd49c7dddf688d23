"""Change of the resolution of a grid in blocks, tile by tile of the result: only tiles that hold something are made.

A coarse voxel is the largest of its parts, wherever a window of the fine grid cuts through them. So windows of bounded
size make up a tile, whatever the ratio.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int, Shaped

from ..._runtime.memory import check_memory
from ..blocks.block_array import BLOCK_VOXELS, BlockArray, lattice_shape
from ..blocks.block_builder import BlockBuilder, split
from ..blocks.windows import cut_tiles
from ..blocks.words import BLOCK
from .axis_plans import AxisPlan, known_log_odds, plan_axis, take_largest, without_mark
from .lattice import check_places, origin_in_voxels, origin_of_cell


class _Piece(NamedTuple):
    """A run of a grid's voxels along an axis, and the cells of the result that they go into.

    Attributes:
        voxels: First voxel of the run and one past its last.
        cells: First cell and one past the last.
        plan: Which of the run's voxels go into which of these cells.
    """

    voxels: tuple[int, int]
    cells: tuple[int, int]
    plan: AxisPlan


def rescale_blocks(
    states: BlockArray,
    origin: Float[np.ndarray, "3"],
    voxel_size: float,
    new_voxel_size: float,
    log_odds: BlockArray | None = None,
    *,
    most: int = 1 << 22,
) -> tuple[BlockArray, Float64[np.ndarray, "3"], BlockArray | None]:
    """Bring a grid in blocks to another voxel size, as `rescale.rescale_states` does with a dense one.

    Args:
        states: uint8 (x, y, z): 0 unknown, 1 free, 2 occupied.
        origin: Outer corner [m].
        voxel_size: Width of the grid's voxels [m].
        new_voxel_size: Width of the result's voxels [m].
        log_odds: float32, or None.
        most: Voxels of a tile of the result, about.

    Returns:
        States, origin and log-odds (None if not given) of the result.

    Raises:
        InputError: If the result would have more than 2**31 - 1 blocks, need more memory than there is, or lies so far
            away that float64 cannot place it.
    """
    if not all(states.shape):
        return states, np.asarray(origin, np.float64), log_odds
    base, ratio = origin_in_voxels(origin, voxel_size), voxel_size / new_voxel_size
    _check_memory(states, ratio, has_log_odds=log_odds is not None)
    check_places(np.stack([base, base + states.shape]) * voxel_size, new_voxel_size)
    plans = [plan_axis(base[a], states.shape[a], ratio) for a in range(3)]
    builders = _builders(tuple(len(plan.index) for plan in plans), has_log_odds=log_odds is not None)
    for tile in cut_tiles(tuple(len(plan.index) for plan in plans), halo=0, most=most):
        pieces = [
            list(_pieces(plan, int(a), int(b), side))
            for plan, a, b, side in zip(plans, tile.low, tile.high, states.shape, strict=True)
        ]
        made = _tile(states, log_odds, pieces, tile.low, tile.high)
        # Nothing is made where the grid has nothing.
        for builder, values in zip(builders, made, strict=False):
            index, blocks = split(values)
            builder.add(index + tile.low // BLOCK, blocks)
    found = [builder.finish() for builder in builders]
    new_origin = origin_of_cell(np.array([plan.low for plan in plans]), new_voxel_size)
    return found[0], new_origin, found[1] if log_odds is not None else None


def _builders(shape: tuple[int, ...], *, has_log_odds: bool) -> list[BlockBuilder]:
    """What states and, where there are, log-odds are put together in."""
    return [BlockBuilder(shape, kind) for kind in (np.uint8, np.float32)[: 2 if has_log_odds else 1]]


def _check_memory(states: BlockArray, ratio: float, *, has_log_odds: bool) -> None:
    """Refuse what would be too large before anything is allocated for it; `ratio` is that of old and new voxel size."""
    sides = [max(int(side * ratio), 1) for side in states.shape]
    a, b, c = lattice_shape(tuple(sides))
    num_mixed = float(np.count_nonzero(~states.is_uniform)) * max(ratio**3, 1.0)
    # Blocks are put together from pieces, so that they are there twice; the plan of an axis has two numbers a cell.
    need = 2.0 * BLOCK_VOXELS * num_mixed * (5 if has_log_odds else 1) + 4.0 * a * b * c + 16.0 * sum(sides)
    box = " x ".join(f"{side:,}" if side < 1e12 else f"{side:.3g}" for side in sides)
    what, advice = f"the map at the new voxel size, of {box} voxels,", "choose a larger voxel size"
    check_memory(need, what, advice, on_device=False)


def _pieces(plan: AxisPlan, first: int, last: int, side: int) -> Iterator[_Piece]:
    """Runs of voxels, of whole blocks but at their ends, that make up the cells from `first` up to and without `last`.

    Args:
        plan: Of the axis.
        first: Lowest cell.
        last: One past the highest.
        side: How many voxels the grid has along the axis.
    """
    longest = 32 * BLOCK
    index = plan.index
    start = int(index[first])
    stop = int(index[last - 1]) + 1
    if plan.is_coarser:
        stop = int(index[last]) if last < len(index) else side
    ends = [*range((start // longest + 1) * longest, stop, longest), stop]
    for low, high in zip([start, *ends[:-1]], ends, strict=True):
        # A coarse cell may have begun in the run before.
        begin = (
            int(np.searchsorted(index, low, "right")) - 1
            if plan.is_coarser
            else int(np.searchsorted(index, low))
        )
        begin, end = max(begin, first), min(int(np.searchsorted(index, high)), last)
        if end > begin:
            yield _Piece(
                (low, high), (begin, end), AxisPlan(0, np.maximum(index[begin:end] - low, 0), plan.is_coarser)
            )


def _tile(
    states: BlockArray,
    log_odds: BlockArray | None,
    pieces: Sequence[Sequence[_Piece]],
    first: Int[np.ndarray, "3"],
    last: Int[np.ndarray, "3"],
) -> list[Shaped[np.ndarray, "u v w"]]:
    """States and log-odds of a tile, dense; nothing where the grid has nothing there."""
    made: list[np.ndarray] = []
    for combination in ((x, y, z) for x in pieces[0] for y in pieces[1] for z in pieces[2]):
        low, high = (tuple(piece.voxels[end] for piece in combination) for end in (0, 1))
        if not _has_any(states, low, high):
            continue
        if not made:
            made = [np.zeros(last - first, np.uint8)]
            if log_odds is not None:
                made.append(np.full(last - first, -np.inf, np.float32))
        cells = tuple(
            slice(piece.cells[0] - a, piece.cells[1] - a)
            for piece, a in zip(combination, first.tolist(), strict=True)
        )
        plans = [piece.plan for piece in combination]
        window = states.window(low, high)
        np.maximum(made[0][cells], take_largest(window, plans), out=made[0][cells])
        if log_odds is not None:
            known = known_log_odds(window, log_odds.window(low, high))
            np.maximum(made[1][cells], take_largest(known, plans), out=made[1][cells])
    if len(made) > 1:
        made[1] = without_mark(made[0], made[1])
    return made


def _has_any(states: BlockArray, low: tuple[int, ...], high: tuple[int, ...]) -> bool:
    """Whether a window of a grid may hold anything."""
    blocks = tuple(slice(a // BLOCK, -(-b // BLOCK)) for a, b in zip(low, high, strict=True))
    return bool(np.asarray(states.table)[blocks].any())
