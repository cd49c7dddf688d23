"""Tables that kernels only look up: of few lengths, so that few kernels are compiled; memory for what is in them.

A compiled kernel belongs to the shapes of its arguments. On a CPU a table is reserved at one of few lengths, in memory
that the operating system provides page by page as it is written; JAX takes such an array as it is, without a copy.
Accelerators know no such memory, and have the finer ladder of `_runtime.buckets`.
"""

import contextlib
import errno
import mmap

import numpy as np

from .._checks import InputError
from .buckets import bucket_size, wide_bucket_size
from .placement import on_host

MAX_CELLS = (1 << 31) - 64
"""Largest table of a volume: kernels count its cells, and one past its end, in int32."""

MAX_ROWS = (1 << 26) - 64
"""Longest table of a list: keys of the nearest voxel keep 26 bits for its row."""


def check_cells(num_cells: int | float, num_rows: int | float, what: str, advice: str) -> None:
    """Raise if a volume, or the list of voxels in it, has more entries than kernels can count.

    Args:
        num_cells: Cells of the volume.
        num_rows: Rows of the list.
        what: What they belong to, as the subject of a sentence.
        advice: What to do instead.

    Raises:
        InputError: If there are more than `MAX_CELLS` cells or `MAX_ROWS` rows.
    """
    for count, most, kind in ((num_cells, MAX_CELLS, "voxels"), (num_rows, MAX_ROWS, "occupied voxels")):
        if count > most:
            raise InputError(
                f"{what} must have at most {most / 1e6:,.0f} million {kind} so that 32 bits count them, got "
                f"{count / 1e6:,.0f} million; {advice}."
            )


MAX_POOL_ROWS = MAX_CELLS >> 9
"""Longest pool of blocks of 512 cells: kernels count its cells in int32."""


def pool_lengths(num_blocks: int, num_rows: int, num_points: int) -> tuple[int, int, int]:
    """Lengths of the tables for a map in blocks of 512 cells; few different ones.

    Args:
        num_blocks: Blocks of the box.
        num_rows: Rows of the pool of blocks.
        num_points: Rows of the list of occupied voxels.

    Returns:
        Length of the table of blocks, of the pools [row], and of the lists.

    Raises:
        InputError: If there are more than kernels can count.
    """
    check_pool(num_blocks, num_rows, num_points, "a map")
    if not on_host():
        rows, points = bucket_size(num_rows, 1 << 11), bucket_size(num_points, 1 << 14)
        blocks = min(bucket_size(num_blocks, 1 << 14), MAX_CELLS)
        return blocks, min(rows, MAX_POOL_ROWS), min(points, MAX_ROWS)
    # Addresses alone are reserved. Lists are tied to pools, so that there are as few pairs of lengths as lengths; the
    # last step of either is what kernels count.
    points_a_row = 8
    rows = wide_bucket_size(max(num_rows, -(-num_points // points_a_row)), 1 << 16)
    blocks = min(wide_bucket_size(num_blocks, 1 << 20), MAX_CELLS)
    if rows > MAX_POOL_ROWS:
        return blocks, MAX_POOL_ROWS, MAX_ROWS
    return blocks, rows, points_a_row * rows


def check_pool(num_blocks: int | float, num_rows: int | float, num_points: int | float, what: str) -> None:
    """Raise if a map in blocks has more of anything than kernels count.

    Args:
        num_blocks: Blocks of the box.
        num_rows: Rows of the pool of blocks.
        num_points: Rows of the list of occupied voxels.
        what: What they belong to, as the subject of a sentence.

    Raises:
        InputError: If there are more blocks than `MAX_CELLS`, rows than `MAX_POOL_ROWS` or voxels than `MAX_ROWS`.
    """
    check_cells(0, num_points, what, "take a larger voxel size, or crop the map")
    for count, most, kind in (
        (num_blocks, MAX_CELLS, "blocks of 8 x 8 x 8 voxels"),
        (num_rows, MAX_POOL_ROWS, "blocks near surfaces"),
    ):
        if count > most:
            raise InputError(
                f"{what} must have at most {most / 1e6:,.0f} million {kind} so that 32 bits count them, got "
                f"{count / 1e6:,.1f} million; take a larger voxel size, or crop the map."
            )


def table_length(num_entries: int, smallest: int = 1 << 25) -> int:
    """Length of a table that holds so many entries, one of few: a rung of `bucket_size`, at most `MAX_CELLS`.

    Args:
        num_entries: At most `MAX_CELLS`, see `check_cells`.
        smallest: First rung on a CPU, which takes no memory of it but what is written: more than what is worked on at
            once (`ops.blocks.windows`), so that nearly all tables share one length. Accelerators begin at a 32nd of it.
    """
    first = smallest if on_host() else smallest >> 5
    return min(bucket_size(num_entries, first), MAX_CELLS)


def reserve(length: int, *row: int, dtype: np.typing.DTypeLike) -> np.ndarray:
    """Zeros (length, *row) that take memory where they are written only.

    Not from NumPy's allocator: what it gives back to be used again it clears, which takes all of it.
    """
    kind = np.dtype(dtype)
    count = length * int(np.prod(row, dtype=np.int64))
    # The operating system maps no memory of length 0.
    if count == 0:
        return np.zeros((length, *row), kind)
    # The array holds on to the mapping, which is given back with it.
    return np.frombuffer(_pages(count * kind.itemsize), kind, count).reshape(length, *row)


def _pages(num_bytes: int) -> mmap.mmap:
    """Memory of the operating system; in huge pages where there are any, which spares most of the page faults."""
    # Fewer bytes have small pages: a huge one may be larger than what is in them.
    least_huge = 1 << 22
    # Private: memory that processes could share gets no huge pages.
    is_private = hasattr(mmap, "MAP_PRIVATE")
    options = {"flags": mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS} if is_private else {}
    try:
        pages = mmap.mmap(-1, num_bytes, **options)
    except OSError as error:
        # NumPy's allocator raises this where memory is short, and callers know no other sign of it.
        if error.errno == errno.ENOMEM:
            raise MemoryError(f"{num_bytes / 1e9:.1f} GB of memory cannot be reserved") from error
        raise
    if num_bytes >= least_huge and hasattr(mmap, "MADV_HUGEPAGE"):
        with contextlib.suppress(OSError):  # a kernel without huge pages: the small ones serve as well
            pages.madvise(mmap.MADV_HUGEPAGE)
    return pages


def as_table(rows: np.ndarray, length: int) -> np.ndarray:
    """`rows`, followed by zeros up to a length."""
    table = reserve(length, *rows.shape[1:], dtype=rows.dtype)
    table[: len(rows)] = rows
    return table
