"""Tables that kernels only look up: of few lengths, so that few kernels are compiled; memory for what is in them.

A compiled kernel belongs to the shapes of its arguments. On a CPU a table is reserved at one of few lengths, each eight
times the one before, in memory that the operating system provides page by page as it is written; JAX takes such an
array as it is, without a copy. Accelerators know no such memory, and have the finer ladder of `_runtime.buckets`.
"""

import contextlib
import mmap

import numpy as np

from .buckets import bucket_size
from .placement import on_host

_STEP = 8
_SMALLEST = 1 << 25
"""Cells of the smallest table of a volume."""
_CELLS_A_ROW = 64
"""Cells of a volume for each row of a list that belongs to it: maps have fewer occupied voxels than that, as a rule, so
that one level serves both."""


_HUGE = 1 << 22
"""Tables of fewer bytes have small pages: a huge one may be larger than what is in them."""


def table_lengths(num_cells: int, num_rows: int) -> tuple[int, int]:
    """Lengths of the tables for a volume and for a list of voxels in it; few different pairs.

    Args:
        num_cells: Cells of the volume.
        num_rows: Rows of the list.
    """
    if not on_host():
        return bucket_size(num_cells, 1 << 20), bucket_size(num_rows, 1 << 14)
    cells = _SMALLEST
    while cells < num_cells or cells // _CELLS_A_ROW < num_rows:
        cells *= _STEP
    return cells, cells // _CELLS_A_ROW


def reserve(length: int, *row: int, dtype: np.typing.DTypeLike) -> np.ndarray:
    """Zeros (length, *row) that take memory where they are written only.

    Not from NumPy's allocator: what it gives back to be used again it clears, which takes all of it.
    """
    kind = np.dtype(dtype)
    count = length * int(np.prod(row, dtype=np.int64))
    if count == 0:
        return np.zeros((length, *row), kind)
    return np.frombuffer(_pages(count * kind.itemsize), kind, count).reshape(length, *row)


def _pages(num_bytes: int) -> mmap.mmap:
    """Memory of the operating system; in huge pages where there are any, which spares most of the page faults."""
    if not hasattr(mmap, "MAP_PRIVATE"):
        return mmap.mmap(-1, num_bytes)
    # Private: memory that processes could share gets no huge pages.
    pages = mmap.mmap(-1, num_bytes, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    if num_bytes >= _HUGE and hasattr(mmap, "MADV_HUGEPAGE"):
        with contextlib.suppress(OSError):  # a kernel without huge pages: the small ones serve as well
            pages.madvise(mmap.MADV_HUGEPAGE)
    return pages


def as_table(rows: np.ndarray, length: int) -> np.ndarray:
    """`rows`, followed by zeros up to a length."""
    table = reserve(length, *rows.shape[1:], dtype=rows.dtype)
    table[: len(rows)] = rows
    return table
