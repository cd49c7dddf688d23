"""The GPU kernels, step by step on the CPU, and as far towards a GPU as lowering goes without one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from device_path import some_gpu
from oracles import sliding_window
from voxjax._checks import InputError
from voxjax.ops.window import box_pallas
from voxjax.ops.window.box import box_count
from voxjax.ops.window.box_pallas import box_count_pallas, window_classes_pallas
from voxjax.ops.window.classes import window_classes


def _grid(shape, share=0.4, seed=0):
    """Bytes that are 0 or any other value."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < share, rng.integers(1, 256, shape), 0).astype(np.uint8)


@pytest.mark.parametrize(
    ("shape", "size", "margin"),
    [((5, 6, 8), 3, 0), ((9, 5, 11), 7, 0), ((3, 5, 300), 5, 3), ((1, 1, 1), 15, 0)],
)
def test_kernel_counts_equal_shifted_copies_also_around_the_grid(shape, size, margin):
    grid = _grid(shape)
    counts = box_count_pallas(grid, size, margin=margin, interpret=True)
    assert counts.dtype == jnp.uint16
    expected = sliding_window.window_count(np.pad(grid, margin), size)
    np.testing.assert_array_equal(np.asarray(counts), expected)


def test_kernel_counts_join_where_one_program_ends_and_the_next_begins(monkeypatch):
    monkeypatch.setattr(box_pallas, "_STRETCH", 4)
    grid = _grid((11, 70, 30))  # 18 groups of rows times 8 words: two blocks of lanes
    counts = box_count_pallas(grid, 3, interpret=True)
    np.testing.assert_array_equal(np.asarray(counts), sliding_window.window_count(grid, 3))


def test_kernel_reaches_the_largest_count():
    full = np.full((15, 15, 16), 255, np.uint8)
    assert int(box_count_pallas(full, 15, interpret=True)[7, 7, 7]) == 15**3


@pytest.mark.parametrize(("share", "shift"), [(0.3, 3), (0.02, 4), (0.0, 1)])
def test_kernel_classes_equal_the_loop(share, shift):
    grid = _grid((6, 9, 11), share)
    classes = window_classes_pallas(grid, np.int32(40), 5, shift, interpret=True)
    assert classes.dtype == jnp.uint8
    np.testing.assert_array_equal(np.asarray(classes), sliding_window.classes(grid != 0, 5, shift, 40))


@pytest.mark.filterwarnings("ignore:The Pallas Triton backend is deprecated:DeprecationWarning")
@pytest.mark.parametrize(
    ("kernel", "num_kernels"),
    [
        (lambda grid: box_count(grid, implementation="pallas"), 1),
        (lambda grid: window_classes(grid, jnp.int32(20), implementation="pallas"), 2),
    ],
)
def test_kernels_are_lowered_for_cuda_by_the_triton_backend(kernel, num_kernels, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    grid = jax.ShapeDtypeStruct((1024, 1024, 512), np.uint8)
    with some_gpu():
        text = jax.jit(kernel).trace(grid).lower(lowering_platforms=("cuda",)).as_text()
    assert text.count("custom_call @__gpu$xla.gpu.triton") == num_kernels


@pytest.mark.parametrize(
    "kernel",
    [
        lambda grid: box_count(grid, implementation="pallas"),
        lambda grid: window_classes(grid, np.int32(20), implementation="pallas"),
    ],
)
def test_without_a_gpu_the_kernels_are_refused(kernel, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "cpu")
    with pytest.raises(NotImplementedError, match="needs a GPU"):
        kernel(np.zeros((3, 3, 4), bool))


def test_more_windows_than_int32_counts_are_refused():
    grid = jax.ShapeDtypeStruct((2048, 1024, 1024), np.uint8)
    with pytest.raises(InputError, match=r"2\*\*31"):
        jax.eval_shape(lambda occupied: box_count_pallas(occupied, 7, interpret=True), grid)
