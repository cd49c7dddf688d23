"""Which known voxels lie outermost along given directions: they decide the box of a moved grid."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from ..blocks.block_array import BLOCK_VOXELS, BlockArray
from ..blocks.words import BLOCK
from .stored import Stored


def outermost(
    states: np.ndarray | BlockArray | Stored, directions: Float[np.ndarray, "d 3"]
) -> Int[np.ndarray, "n 3"]:
    """Known voxels such that none lies farther along any of the directions; none where nothing is known."""
    if isinstance(states, BlockArray):
        return outermost_in_blocks(states, directions)
    return outermost_in_store(states, directions) if isinstance(states, Stored) else outermost_known(states)


def outermost_known(states: np.ndarray) -> Int[np.ndarray, "n 3"]:
    """Lowest and highest known voxel of each column along z of a dense grid; they have the convex hull of all."""
    is_known = states != 0
    if not is_known.any():
        return np.zeros((0, 3), np.int64)
    columns = np.argwhere(is_known.any(axis=2))
    z_low = is_known.argmax(axis=2)[tuple(columns.T)]
    z_high = states.shape[2] - 1 - is_known[:, :, ::-1].argmax(axis=2)[tuple(columns.T)]
    ends = [np.concatenate([columns, z[:, None]], axis=1) for z in (z_low, z_high)]
    return np.concatenate(ends, axis=0)


def outermost_in_blocks(states: BlockArray, directions: Float[np.ndarray, "d 3"]) -> Int[np.ndarray, "n 3"]:
    """A voxel that is not 0 for each direction such that none lies farther along it; none where all are 0."""
    cells = np.stack(np.unravel_index(np.arange(BLOCK_VOXELS), (BLOCK,) * 3), axis=1)
    # A block that is not all 0 has a voxel at the nearest of its places at worst, and at the farthest at best.
    along = directions @ cells.T
    nearest, farthest = along.min(axis=1), along.max(axis=1)
    best = np.full(len(directions), -np.inf)
    for blocks in _known_blocks(states):
        best = np.maximum(best, (BLOCK * directions @ blocks.T).max(axis=1) + nearest)
    found = np.zeros((len(directions), 3), np.int64)
    if np.isinf(best).any():
        return found[:0]
    table, pool = np.asarray(states.table), np.asarray(states.pool)
    for blocks in _known_blocks(states):
        at_corner = BLOCK * directions @ blocks.T
        for number in range(len(directions)):
            # Rounding must not leave out the block that has decided the bound.
            chosen = np.flatnonzero(at_corner[number] + farthest[number] >= best[number] - 1e-6)
            if not len(chosen):
                continue
            rows, index = np.unique(table[tuple(blocks[chosen].T)], return_inverse=True)
            reach = np.where(pool[rows].reshape(-1, BLOCK_VOXELS) != 0, along[number], -np.inf)
            total = at_corner[number, chosen] + reach.max(axis=1)[index.reshape(-1)]
            first = int(total.argmax())
            if total[first] >= best[number]:
                best[number] = total[first]
                cell = int(reach[index.reshape(-1)[first]].argmax())
                found[number] = BLOCK * blocks[chosen[first]] + cells[cell]
    return found


def outermost_in_store(states: Stored, directions: Float[np.ndarray, "d 3"]) -> Int[np.ndarray, "n 3"]:
    """Like `outermost_in_blocks`; of the cubes those are read that may hold such a voxel."""
    low = states.side * np.argwhere(states.cubes)
    high = np.minimum(low + states.side, states.shape)
    found = []
    for direction in directions:
        # No voxel of a cube lies farther than this; cubes are read until none can hold a farther one.
        bound = np.where(direction > 0, high - 1, low) @ direction
        best, voxel = -np.inf, None
        for number in np.argsort(-bound):
            if bound[number] <= best:
                break
            corners = tuple(low[number].tolist()), tuple(high[number].tolist())
            known = outermost_known(states.read(*corners)[0]) + low[number]
            along = known @ direction
            if len(known) and along.max() > best:
                best, voxel = along.max(), known[along.argmax()]
        if voxel is None:
            return np.zeros((0, 3), np.int64)
        found.append(voxel)
    return np.asarray(found)


def _known_blocks(states: BlockArray) -> Iterator[Int[np.ndarray, "m 3"]]:
    """Blocks that are not all 0, about a hundred thousand at a time."""
    table = np.asarray(states.table)
    step = max((1 << 17) // max(table.shape[1] * table.shape[2], 1), 1)
    for start in range(0, len(table), step):
        blocks = np.argwhere(table[start : start + step])
        if len(blocks):
            blocks[:, 0] += start
            yield blocks
