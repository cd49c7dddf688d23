"""Rows of the benchmark of kernels: their modules are found, their references are right."""

import numpy as np
from bench.kernel_rows import box as box_rows

from bench import kernels
from oracles import sliding_window


def test_every_module_of_rows_is_found():
    assert {"window", "compaction"} <= set(kernels.module_names())
    assert "scene" not in kernels.module_names()


def test_references_of_the_count_equal_the_oracle():
    occupied = (np.random.default_rng(0).random((9, 10, 11)) < 0.4).astype(np.uint8)
    for size in (3, 7, 15):
        np.testing.assert_array_equal(
            box_rows.numpy_adds(occupied, size), sliding_window.window_count(occupied, size)
        )
