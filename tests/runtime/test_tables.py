"""Reserved tables: lengths of few kinds, memory only where written, no copy by JAX."""

import errno
import mmap
import os

import jax
import numpy as np
import pytest

from voxjax._checks import InputError
from voxjax._runtime import placement
from voxjax._runtime.tables import MAX_CELLS, MAX_ROWS, as_table, check_cells, reserve, table_length
from voxjax._runtime.threads import num_cores, spread


def test_lengths_hold_what_is_asked_for_and_are_few():
    assert {table_length(cells) for cells in range(0, 1 << 25, 999_983)} == {1 << 25}
    assert len({table_length(cells) for cells in range(0, 10**8, 999_983)}) <= 4
    for cells in (5, 1 << 25, (1 << 25) + 1, 10**9):
        assert table_length(cells) >= cells


def test_accelerators_have_the_finer_ladder(monkeypatch):
    monkeypatch.setattr(placement, "backend", lambda: "gpu")
    assert 10_000_000 <= table_length(10_000_000) <= 1.5 * 10_000_000


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="resident memory is read from /proc")
def test_reserved_memory_is_taken_where_written():
    def resident() -> int:
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    before = resident()
    table = reserve(1 << 28, dtype=np.uint32)
    table[:1000] = 1
    assert table.shape == (1 << 28,)
    assert table[999] == 1
    assert table[1 << 27] == 0
    assert resident() - before < 1 << 26


def test_table_begins_with_its_rows():
    rows = np.arange(12, dtype=np.float32).reshape(4, 3)
    table = as_table(rows, 9)
    assert table.dtype == np.float32
    assert (table[:4] == rows).all()
    assert (table[4:] == 0).all()
    assert reserve(0, 3, dtype=np.float32).shape == (0, 3)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="accelerators copy")
def test_jax_takes_a_table_without_a_copy():
    table = reserve(1 << 21, dtype=np.uint8)
    table[5] = 7
    held = jax.device_put(table)
    assert held.unsafe_buffer_pointer() == table.ctypes.data
    assert int(held[5]) == 7


def test_memory_that_the_system_refuses_is_a_memory_error(monkeypatch):
    def refuse(*_, **__):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(mmap, "mmap", refuse)
    number = errno.ENOMEM
    with pytest.raises(MemoryError, match=r"0\.0 GB of memory cannot be reserved"):
        reserve(10, dtype=np.uint8)
    number = errno.EPERM  # no sign of short memory
    with pytest.raises(PermissionError):
        reserve(10, dtype=np.uint8)


def test_spread_keeps_the_order_and_raises_what_a_piece_raised():
    assert spread(lambda x: x * x, range(20)) == [x * x for x in range(20)]
    assert num_cores() >= 1
    with pytest.raises(ZeroDivisionError):
        spread(lambda x: 1 // x, [1, 0, 2])


HUGE = (936, 1698, 174)
"""A site of 468 x 849 x 87 m in voxels of 0.5 m: a little more than 2^28 of them."""


@pytest.mark.parametrize("name", ["cpu", "gpu"])
@pytest.mark.parametrize("cells", [int(np.prod(HUGE)), 1 << 30, MAX_CELLS])
def test_no_table_is_longer_than_int32_counts(monkeypatch: pytest.MonkeyPatch, name: str, cells: int) -> None:
    monkeypatch.setattr(placement, "backend", lambda: name)
    assert cells <= table_length(cells) <= MAX_CELLS
    np.arange(2, dtype=np.int32) + np.int32(MAX_CELLS)  # one past the end is a number of 32 bits


@pytest.mark.parametrize(("cells", "rows"), [(MAX_CELLS + 1, 1), (1, MAX_ROWS + 1)])
def test_more_than_int32_counts_is_refused_in_a_sentence(cells: int, rows: int) -> None:
    with pytest.raises(
        InputError, match=r"a map must have at most .* million (occupied )?voxels .*; take a larger"
    ):
        check_cells(cells, rows, "a map", "take a larger voxel size")


def test_the_ladder_reserves_at_most_half_more_than_a_large_map_needs() -> None:
    for cells in range(1 << 28, MAX_CELLS, 99_999_989):
        assert table_length(cells) <= 1.5 * cells
