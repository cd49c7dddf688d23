"""Work on pairs of near tiles, item by item: from the host in pieces of one size, or in one kernel.

On a CPU pieces run side by side, memory is bounded, and another number of points compiles nothing. NumPy adds and
multiplies there: it takes half the time of XLA for small batched products and for sums over runs of rows.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._runtime.pieces import each_piece
from ..._runtime.threads import spread
from ..._types import Array
from .pairs import FAR
from .tiles import GROUP, LEAF, TILE, NearTiles

_ITEMS = 512
"""Items of a piece on a CPU, a million pairs; smaller ones wait longer for their calls."""

Evaluate = Callable[[Any, Any], Any]
"""From the tiles (i,) and the half tiles near them (i, 16) of some items to what each adds: (i, *shape)."""


@dataclasses.dataclass(frozen=True)
class ItemWork:
    """How to go through the items of some tiles.

    Attributes:
        near: The tiles.
        from_host: In pieces with NumPy arrays in between; else in one kernel, under any transformation.
    """

    near: NearTiles
    from_host: bool

    @property
    def xp(self) -> Any:
        """NumPy, or JAX's."""
        return np if self.from_host else jnp

    def tables(self, columns: Any) -> tuple[Any, Any]:
        """Columns of the points (c, n) by tile (c, t, 16) and by half tile (c, 2 t, 8), FAR where a place is empty."""
        # Empty places name the row after the last point: it is there, and far from everything.
        padded = self.xp.concatenate(
            [columns, self.xp.full((columns.shape[0], 1), FAR, columns.dtype)], axis=1
        )
        halves = self.xp.take(padded, self.near.rows, axis=1)
        return halves.reshape(columns.shape[0], -1, TILE), halves

    def take(self, tables: tuple[Any, Any], tiles: Any, halves: Any) -> tuple[Any, Any]:
        """Columns of the points of some items: (c, i, 16) and (c, i, 128)."""
        others = self.xp.take(tables[1], halves, axis=1)
        return self.xp.take(tables[0], tiles, axis=1), others.reshape(*others.shape[:2], -1)

    def mix(self, weights: Any, values: Callable[[slice], Any]) -> Any:
        """Sums of the others' values, weighted for each own point.

        Args:
            weights: (i, 128, 16).
            values: From some of the items to what belongs to their others: (128 w numbers an item).

        Returns:
            (i, 16, w).
        """
        if not self.from_host:
            rows = values(slice(None)).reshape(*weights.shape[:2], -1)
            return jnp.einsum("iht,ihw->itw", weights, rows, precision="highest")
        # So few items at once that weights, values and products stay in the cache of a core.
        together = 32
        turned, products = np.asarray(weights).swapaxes(1, 2), []
        for first in range(0, len(turned), together):
            part = slice(first, first + together)
            products.append(
                np.matmul(turned[part], values(part).reshape(len(turned[part]), GROUP * LEAF, -1))
            )
        return np.concatenate(products)

    def add_up(self, evaluate: Evaluate, shape: tuple[int, int]) -> Any:
        """What the items of each tile add up to: float32 (t, *shape)."""
        zeros = self.xp.zeros((self.near.rows.shape[0] // 2, *shape), np.float32)
        return (
            _add_pieces(evaluate, self.near, zeros) if self.from_host else _scan(evaluate, self.near, zeros)
        )

    def by_parts(self, function: Callable[[Any], Any], tiles: Any) -> Any:
        """A function that takes each tile for itself, of the rows (t, ...) of all tiles; rows (t, ...) as well."""
        if not self.from_host:
            return function(tiles)
        # Tiles of one call: enough calls for all cores, and what each writes in between stays in a cache.
        together = 256
        firsts = range(0, len(tiles), together)
        return np.concatenate(spread(lambda first: function(tiles[first : first + together]), firsts))

    def by_point(self, values: Any, count: int) -> Any:
        """Values (16 t, w) in the order of the points: (count, w)."""
        rows, shape = self.near.rows.reshape(-1), (count + 1, values.shape[1])
        # Empty places write the last row.
        if not self.from_host:
            return jnp.zeros(shape, values.dtype).at[rows].set(values)[:count]
        result = np.zeros(shape, values.dtype)
        result[rows] = values
        return result[:count]


def _add_pieces(evaluate: Evaluate, near: NearTiles, total: np.ndarray) -> np.ndarray:
    """Sums by tile of the pieces, added in their order, whatever the number of cores."""
    own, others = np.asarray(near.own), np.asarray(near.others)
    empty = near.rows.shape[0] - 1

    def sum_by_tile(tiles: np.ndarray, halves: np.ndarray, count: np.int32) -> tuple[np.ndarray, np.ndarray]:
        # Items of padding see half tiles without points; they are dropped here, before anything is added.
        values, tiles = np.asarray(evaluate(tiles, halves)), tiles[:count]
        # Items are sorted by their tile, so that those of a tile are a run.
        starts = np.flatnonzero(np.diff(tiles, prepend=-1))
        counts = np.diff(starts, append=len(tiles))
        # Tiles with the most items first, so that those that have a k-th one are always a slice.
        starts, counts = (rows[np.argsort(-counts, kind="stable")] for rows in (starts, counts))
        # The k-th items of all tiles that have one: `np.add.reduceat` takes four times as long.
        # Counts come as bytes, which the sum of several items would overflow.
        sums = values[starts].astype(np.float32)
        for k in range(1, counts.max(initial=1)):
            having = np.count_nonzero(counts > k)
            sums[:having] += values[starts[:having] + k]
        return tiles[starts], sums

    for tiles, sums in each_piece(sum_by_tile, [own, others], size=_ITEMS, fills=[0, empty]):
        # Each tile is once in the sums of a piece, so that no addition hides another; a tile that the end of a piece
        # cuts is added to by two pieces.
        total[tiles] += sums
    return total


def _scan(evaluate: Evaluate, near: NearTiles, total: jax.Array) -> jax.Array:
    """Sums by tile, one piece after the other."""
    # Items of one step: what they are evaluated to bounds the memory, however many there are.
    items = 1024
    size = min(items, max(near.own.shape[0], 1))
    padding = -near.own.shape[0] % size
    tiles = jnp.pad(near.own, (0, padding)).reshape(-1, size)
    # Items of padding belong to tile 0 and add nothing to it, for half tiles without points are near to none.
    halves = jnp.pad(near.others, ((0, padding), (0, 0)), constant_values=near.rows.shape[0] - 1)

    def step(total: jax.Array, item: tuple[Array, Array]) -> tuple[jax.Array, None]:
        return total.at[item[0]].add(evaluate(*item).astype(jnp.float32)), None

    return jax.lax.scan(step, total, (tiles, halves.reshape(-1, size, GROUP)))[0]
