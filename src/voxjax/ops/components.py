"""Connected components of occupied voxels, and regions of like normals, on the compact list of voxels.

Each voxel points to a lower row of its component. A round takes the least pointer among the neighbours, hooks it to
the root as well, and shortens the paths; six rounds settle real maps of half a million voxels, where handing labels
on from voxel to voxel takes hundreds. Work and memory of a round grow with the listed voxels, not with the volume.

No stage of the pipeline uses this module: planes grow over pairs of surface elements (`planes.grow`), another thing. It
is a door of its own for whoever labels grids on a device.
"""

import functools
import itertools
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int32
from scipy import ndimage

from .._checks import InputError, check_choice
from .._runtime.buckets import bucket_size, pad_rows
from .._runtime.forks import refused_after_fork
from .._runtime.placement import on_host
from .._runtime.tables import check_cells
from .._types import Array

_RowsOf = Callable[[Array], list[tuple[Array, Array]]]


class Regions(NamedTuple):
    """Components of listed voxels.

    Attributes:
        label: int32 (n,): 1 for the component of the first listed voxel, 2 for the next, and so on; 0 for padding.
        num_regions: int32: how many there are.
        num_rounds: int32: rounds until nothing changed, the last one included.
    """

    label: Int32[Array, "n"]
    num_regions: Int32[Array, ""]
    num_rounds: Int32[Array, ""]


@refused_after_fork
def connected_components(
    occupied: Bool[Array, "x y z"],
    *,
    connectivity: int = 26,
    implementation: str | None = None,
) -> tuple[Int32[Array, "x y z"], int]:
    """Label the connected components of occupied voxels.

    Equals `scipy.ndimage.label`, numbers included: components count from 1 by their first voxel in C order, and 0 is
    not occupied. A host function: the number of occupied voxels decides shapes. Under jit see `label_voxels`.

    Args:
        occupied: True where a voxel is occupied.
        connectivity: Voxels touch by faces (6), also by edges (18), or also by corners (26).
        implementation: "scipy" labels on the host, "compact" runs `label_voxels` on the device. None: "scipy" where
            the device is a CPU, which is the faster there, else "compact".

    Returns:
        Labels and the number of components.

    Raises:
        InputError: If the connectivity or the implementation is unknown, or there are too many voxels.
    """
    # Short lists share one program.
    smallest_list = 1 << 12
    _check_connectivity(connectivity)
    if implementation is None:
        implementation = "scipy" if on_host(occupied) else "compact"
    check_choice("implementation", implementation, ("scipy", "compact"))
    host = np.ascontiguousarray(occupied)
    labels = np.zeros(host.shape, np.int32)
    if implementation == "scipy":
        rank = {6: 1, 18: 2, 26: 3}[connectivity]
        return labels, int(ndimage.label(host, ndimage.generate_binary_structure(3, rank), output=labels))  # pyright: ignore[reportArgumentType]
    # `label_voxels` wants its voxels in C order, and numbers components by it: so the numbers become those of SciPy.
    flat = np.flatnonzero(host)
    index = np.stack(np.unravel_index(flat, host.shape), axis=1).astype(np.int32)
    size = bucket_size(len(flat), smallest_list)
    regions = label_voxels(
        pad_rows(index, size),
        np.arange(size) < len(flat),
        np.asarray(host.shape, np.int32),
        flat_size=padded_size(host.shape),
        connectivity=connectivity,
    )
    # Rows of padding come last, so that cutting the list off drops them.
    labels.reshape(-1)[flat] = np.asarray(regions.label)[: len(flat)]
    return labels, int(regions.num_regions)


@refused_after_fork
@partial(jax.jit, static_argnames=("flat_size", "connectivity"))
def label_voxels(
    index: Int32[Array, "n 3"],
    mask: Bool[Array, "n"],
    dims: Int32[Array, "3"],
    *,
    flat_size: int,
    connectivity: int = 26,
) -> Regions:
    """Connected components of a list of voxels.

    Memory: 36 bytes a listed voxel and half a byte a voxel of the block.

    Args:
        index: Voxels inside the block in C order, each at most once, as `argwhere` gives them; padding rows last.
        mask: False for padding rows.
        dims: Size of the block [voxel]; traced, so that another one costs no compilation.
        flat_size: At least `prod(dims + 2)`, see `padded_size`.
        connectivity: 6, 18 or 26.

    Returns:
        `Regions`, rows as in `index`.

    Raises:
        InputError: If the connectivity is unknown, or the list is empty or too long.
    """
    return _label(
        _neighbours(index, mask, dims, flat_size=flat_size, connectivity=connectivity), mask, _ends_of
    )


@refused_after_fork
@partial(jax.jit, static_argnames=("flat_size", "connectivity", "is_signed"))
def grow_regions(
    index: Int32[Array, "n 3"],
    mask: Bool[Array, "n"],
    normal: Float[Array, "n 3"],
    dims: Int32[Array, "3"],
    min_cosine: float | Float[Array, ""],
    *,
    flat_size: int,
    connectivity: int = 26,
    is_signed: bool = True,
) -> Regions:
    """Connected components where only voxels of like normals are joined.

    Two touching voxels belong together if the cosine of the angle between their normals is at least `min_cosine`;
    a region may bend by more than that over its length. Unlike growing from seeds, the order of the voxels does not
    matter.

    Args:
        index: Voxels inside the block in C order, each at most once; padding rows last.
        mask: False for padding rows, and for voxels that shall belong to no region.
        normal: Unit vectors; voxels with a normal of length 0 stay alone.
        dims: Size of the block [voxel]; traced.
        min_cosine: Cosine of the largest angle between the normals of neighbours; traced.
        flat_size: At least `prod(dims + 2)`, see `padded_size`.
        connectivity: 6, 18 or 26.
        is_signed: Whether opposite normals differ; False compares the lines that they lie on.

    Returns:
        `Regions`, rows as in `index`.

    Raises:
        InputError: If the connectivity is unknown, or the list is empty or too long.
    """
    neighbours = _neighbours(index, mask, dims, flat_size=flat_size, connectivity=connectivity)
    # Normals go by columns, because arrays whose last axis is 3 run slowly on a CPU (`evidence.lookup`).
    axes = jnp.asarray(normal).T
    least = jnp.asarray(min_cosine, axes.dtype)

    # One column of the window at a time: cosines of all 26 neighbours at once would take more memory than the table.
    def keep_alike(column: Array) -> Array:
        for k, (row, is_joined) in enumerate(_rows_of(column)):
            # A row past the list is joined to nothing, and must only be readable.
            other = jnp.minimum(row, index.shape[0] - 1)
            cosine = axes[0] * axes[0][other] + axes[1] * axes[1][other] + axes[2] * axes[2][other]
            # Both ends of a pair compute the same cosine, so the table stays symmetric, as `_label` needs it.
            is_unlike = is_joined & ((cosine if is_signed else jnp.abs(cosine)) < least)
            # Only a bit that is set is taken away, so subtracting it clears that bit and no other.
            column = column - jnp.where(is_unlike, np.int32(1 << k), 0)
        return column

    return _label(jax.lax.map(keep_alike, neighbours), mask, _rows_of)


def padded_size(shape: tuple[int, ...]) -> int:
    """Length of the flat block that `label_voxels` needs for a grid, on the ladder of shapes.

    Raises:
        InputError: If the block has more voxels than int32 can count.
    """
    # Small blocks share one program.
    smallest_block = 1 << 15
    num_cells = int(np.prod([side + 2 for side in shape], dtype=np.int64))
    check_cells(num_cells, 0, "a grid and the voxels around it", "label it tile by tile, or on the host")
    return bucket_size(num_cells, smallest_block)


def _neighbours(
    index: Array, mask: Array, dims: Array, *, flat_size: int, connectivity: int
) -> Int32[Array, "k n"]:
    """The neighbours of each listed voxel, column by column of the block.

    A voxel's row is its rank among the listed ones, read from one bit a voxel of the block and one count a word:
    a dense table of rows would be 16 times larger than both. An entry stands for the three voxels of a column that
    could be neighbours: `row << 6 | present << 3 | joined`, the row of the first one that is listed, one bit each for
    being listed and one for being joined. Listing all 26 rows instead took twice the time, for the memory.
    """
    # An entry keeps six bits beside the row, and int32 has no more than 25 others without its sign.
    max_rows = 1 << 25
    _check_connectivity(connectivity)
    if not 0 < index.shape[0] < max_rows:
        raise InputError(
            f"index must have 1 to {max_rows - 1} rows, got {index.shape[0]}; pad it, or use tiles."
        )
    # One empty voxel around the block: no neighbour lies outside, none wraps round.
    height, depth = dims[1] + 2, dims[2] + 2
    place = ((index[:, 0] + 1) * height + index[:, 1] + 1) * depth + index[:, 2] + 1
    # Padding does not rise above the row before it; the first row is a voxel if any is.
    is_new = jnp.concatenate([jnp.any(mask, keepdims=True), place[1:] > place[:-1]])
    bit = jnp.where(is_new, jnp.uint32(1) << (place & 31).astype(jnp.uint32), np.uint32(0))
    # JAX scatters no logical or; no bit comes twice, so that a sum sets each. One word is for the rest of the division
    # by 32, and one more is read, though never set, beside the last.
    words = jnp.zeros((flat_size // 32 + 2,), jnp.uint32).at[place >> 5].add(bit)
    count = jax.lax.population_count(words).astype(jnp.int32)
    # The words before a voxel's own hold so many listed ones; its row is that and the bits below its own.
    rank = jnp.cumsum(count, dtype=jnp.int32) - count

    def look(column: tuple[Array, Array]) -> Array:
        step, wanted = column
        # A column of three begins at z - 1. Rows of padding look at the front of the block, and join nothing below.
        first = jnp.where(mask, place + step - 1, 0)
        word, shift = first >> 5, (first & 31).astype(jnp.uint32)
        low, high = words[word], words[word + 1]
        # Two shifts: one by 32 is not defined.
        present = ((low >> shift) | ((high << (31 - shift)) << 1)) & 7
        # These are the listed voxels of the word that lie before the first one of the column.
        before = low & ((jnp.uint32(1) << shift) - 1)
        row = rank[word] + jax.lax.population_count(before).astype(jnp.int32)
        joined = jnp.where(mask, present & wanted, np.uint32(0))
        return (row << 6) | (present << 3 | joined).astype(jnp.int32)

    columns = _columns(connectivity)
    steps = jnp.stack([(x * height + y) * depth for x, y in columns])
    return jax.lax.map(look, (steps, jnp.asarray(list(columns.values()), jnp.uint32)))


def _rows_of(column: Array) -> list[tuple[Array, Array]]:
    """The rows of the three voxels that an entry stands for, and whether each is joined."""
    row, rows = column >> 6, []
    for k in range(3):
        rows.append((row, ((column >> k) & 1) == 1))
        # Voxels of one column follow each other in the list, so each one that is listed moves the row on by one.
        row = row + ((column >> (3 + k)) & 1)
    return rows


def _ends_of(column: Array) -> list[tuple[Array, Array]]:
    """The first and the last row that an entry joins: one between the two touches both."""
    row, joined = column >> 6, column & 7
    second = row + ((column >> 3) & 1)
    third = second + ((column >> 4) & 1)
    first = jnp.where(joined & 1 == 1, row, jnp.where(joined & 2 == 2, second, third))
    last = jnp.where(joined & 4 == 4, third, jnp.where(joined & 2 == 2, second, row))
    return [(first, joined > 0), (last, joined > 0)]


def _label(neighbours: Int32[Array, "k n"], mask: Bool[Array, "n"], rows_of: _RowsOf) -> Regions:
    """Components of a symmetric table of neighbours, numbered by their lowest rows.

    Args:
        neighbours: Table that `_neighbours` gives.
        mask: Rows that take part.
        rows_of: The rows that entries join, and whether they do.
    """
    num_rows = mask.shape[0]
    own = jnp.arange(num_rows, dtype=jnp.int32)
    # Rows that take no part point past the end, which is less than nothing.
    nothing = jnp.full((1,), num_rows, jnp.int32)

    def take_round(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        parent, _, num_rounds = state
        # What each voxel meets: the least row that any of its neighbours points to.
        met = [jnp.where(is_joined, parent[row], num_rows) for row, is_joined in rows_of(neighbours)]
        least = jnp.min(functools.reduce(jnp.minimum, met), axis=0)
        least = jnp.where(mask, jnp.minimum(parent[:-1], least), num_rows)
        # The root learns what its voxels met, so that whole components join in one round.
        hooked = jnp.concatenate([least, nothing]).at[parent[:-1]].min(least)
        # Paths are shortened to a quarter; longer ones wait for the next round.
        for _ in range(2):
            hooked = hooked[hooked]
        return hooked, jnp.any(hooked != parent), num_rounds + 1

    # Each voxel begins as its own root. Pointers only ever fall, and not below the lowest row of the component: so the
    # rounds come to an end, and they end there.
    start = jnp.concatenate([jnp.where(mask, own, num_rows), nothing])
    state = (start, jnp.asarray(True), jnp.zeros((), jnp.int32))
    root, _, num_rounds = jax.lax.while_loop(lambda state: state[1], take_round, state)
    # Roots are the first voxels of their components, so counting them in order numbers components as SciPy does.
    is_root = mask & (root[:-1] == own)
    number = jnp.cumsum(is_root, dtype=jnp.int32)
    # Roots of rows that take no part lie past the numbers, and are looked up within them only to be masked.
    label = jnp.where(mask, number[jnp.minimum(root[:-1], num_rows - 1)], 0)
    return Regions(label, jnp.sum(is_root, dtype=jnp.int32), num_rounds)


def _columns(connectivity: int) -> dict[tuple[int, int], int]:
    """The columns beside a voxel and its own, with one bit for each of z - 1, z, z + 1 that is a neighbour."""
    reach = {6: 1, 18: 2, 26: 3}[connectivity]
    columns: dict[tuple[int, int], int] = {}
    for x, y, z in itertools.product((-1, 0, 1), repeat=3):
        if 0 < abs(x) + abs(y) + abs(z) <= reach:
            columns[x, y] = columns.get((x, y), 0) | 1 << (z + 1)
    return columns


def _check_connectivity(connectivity: int) -> None:
    if connectivity not in (6, 18, 26):
        raise InputError(f"connectivity must be 6, 18 or 26, got {connectivity!r}.")
