"""Rows of the benchmark of kernels that are made up, and their results."""

import numpy as np
from bench.kernel_row import KernelRow
from bench.timing import Timing

from bench import kernel_results

SETTING = {
    "device": "Some Processor (R), 2 cores",
    "allocator": "default",
    "jax": "1",
    "numpy": "2",
    "scipy": "3",
}


def made_row(**changes) -> KernelRow:
    calls = {"ours": lambda: np.zeros(1), "theirs": lambda: np.zeros(1)}
    options = {"name": "kernel, 4^3", "ours": "ours", "candidates": calls, "count": 1000, "unit": "voxel"}
    return KernelRow(**(options | changes))


def judged(row, ours=1e-3, theirs=4e-3, limit=0.0):
    timings = [Timing(name, 0.5, s, s, s, 3) for name, s in (("ours", ours), ("theirs", theirs))]
    return kernel_results.result_of(row, timings, limit, SETTING, quick=True)
