"""Evidence of every translation at once: the two-way score of a rotated map as a sum of correlations."""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Complex64, Float32, Int32, UInt8

from ..._runtime.precision import in_full_precision
from ..._types import Array
from .lookup import Block, lookup
from .scoring import CONFLICT, HIT, NOTHING


@partial(jax.jit, static_argnames=("cells",))
@in_full_precision
def coarse_spectra(
    codes: UInt8[Array, "flat"],
    block: Block,
    points: Float32[Array, "n 3"],
    weights: Float32[Array, "n"],
    rotation: Float32[Array, "3 3"],
    low: Float32[Array, "3"],
    cell_size: Float32[Array, ""],
    conflict_weight: Float32[Array, ""],
    *,
    cells: tuple[int, int, int],
) -> tuple[Complex64[Array, "x y w"], Complex64[Array, "x y w"]]:
    """Fourier transforms of one rotated map on a coarse block: what it offers, and what it asks.

    Args:
        codes: Evidence codes (`evidence_codes`) at the coarse tolerance, flat over the map's block.
        block: Place and size of that block.
        points: Occupied voxel centres in the map's frame [m].
        weights: Weight of each point; 0 for padding.
        rotation: Maps the map's frame into the frame of the coarse block.
        low: Outer corner of the coarse block [m].
        cell_size: Edge of a coarse cell [m].
        conflict_weight: How many hits a conflict outweighs.
        cells: Size of the coarse block; at least the sum of both maps' sizes, or the correlation wraps.

    Returns:
        Spectrum of the field of values (1 at a hit, minus `conflict_weight` in clear space, 0 elsewhere), and
        spectrum of the weights of the occupied voxels.
    """
    axes = [(jnp.arange(n, dtype=jnp.float32) + 0.5) * cell_size for n in cells]
    centres = jnp.stack(jnp.meshgrid(*axes, indexing="ij"), axis=-1) + low[None, None, None, :]
    # What the map offers is looked up at the centres of cells, turned back into its frame: no cell is missed, as some
    # would be if voxels were brought to cells.
    code = lookup(codes, block, centres @ rotation, NOTHING)
    offer = jnp.where(code == HIT, 1.0, jnp.where(code == CONFLICT, -conflict_weight, 0.0)).astype(
        jnp.float32
    )
    cell = jnp.floor((points @ rotation.T - low[None, :]) / cell_size).astype(jnp.int32)
    # Padding lies anywhere and weighs nothing. What rounding puts one cell below the box wraps to the last cell, which
    # to a transform is the same one.
    ask = jnp.zeros(cells, jnp.float32).at[cell[:, 0], cell[:, 1], cell[:, 2]].add(weights, mode="drop")
    return jnp.fft.rfftn(offer), jnp.fft.rfftn(ask)


@partial(jax.jit, static_argnames=("cells", "num_peaks", "block"))
def correlation_peaks(
    offer_a: Complex64[Array, "x y w"],
    ask_a: Complex64[Array, "x y w"],
    offer_b: Complex64[Array, "x y w"],
    ask_b: Complex64[Array, "x y w"],
    *,
    cells: tuple[int, int, int],
    num_peaks: int,
    block: int = 4,
) -> tuple[Float32[Array, "k"], Int32[Array, "k 3"]]:
    """Best translations of b against a, at most one in each block of cells.

    `score(t) = sum_x offer_a(x + t) ask_b(x) + sum_x ask_a(x + t) offer_b(x)`.

    Returns:
        Scores, best first, and translations [cell], modulo the block, in [0, cells).
    """
    # Both directions are summed before the one transform back.
    spectrum = offer_a * jnp.conj(ask_b) + ask_a * jnp.conj(offer_b)
    score = jnp.fft.irfftn(spectrum, s=cells)
    # One peak a block: the neighbours of the highest cell would otherwise take the places of other translations.
    nx, ny, nz = (n // block for n in cells)
    blocks = score.reshape(nx, block, ny, block, nz, block).transpose(0, 2, 4, 1, 3, 5).reshape(-1, block**3)
    inner = jnp.argmax(blocks, axis=1).astype(jnp.int32)
    top, which = jax.lax.top_k(jnp.max(blocks, axis=1), min(num_peaks, len(blocks)))
    which = which.astype(jnp.int32)
    i = inner[which]
    cell = jnp.stack(
        [
            which // (ny * nz) * block + i // block**2,
            which // nz % ny * block + i // block % block,
            which % nz * block + i % block,
        ],
        axis=-1,
    )
    return top, cell
