"""Checks of arguments: one sentence, whatever is given."""

import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import InputError
from voxjax._checks import (
    check_choice,
    check_count,
    check_odd_window,
    check_pose,
    check_positive,
    check_three_axes,
    check_voxel_size,
    shown,
)

NO_NUMBERS = [
    np.nan,
    np.inf,
    -np.inf,
    0,
    -0.0,
    -1.0,
    10**400,
    10**5000,
    "0.1",
    b"1",
    None,
    [1.0, 2.0],
    object(),
]


@pytest.mark.parametrize("value", NO_NUMBERS, ids=lambda value: shown(value)[:20])
def test_what_is_no_positive_number_is_refused(value):
    with pytest.raises(InputError, match=r"reach must be a finite number above 0 \[m\], got .+\.$") as caught:
        check_positive("reach", value, "m")
    assert len(str(caught.value)) < 250
    with pytest.raises(InputError, match="voxel_size must"):
        check_voxel_size(value)
    with pytest.raises(InputError, match="size must be an odd whole number of voxels"):
        check_odd_window("size", value)


@pytest.mark.parametrize("value", [0.5, 1, np.float32(2), np.float64(3), jnp.float32(0.25)])
def test_numbers_of_all_kinds_are_taken(value):
    assert check_positive("reach", value) == float(value)
    assert check_voxel_size(value) == float(value)


def test_voxels_have_a_size_whose_cube_is_a_number():
    for size in (1e-12, 1e12):
        assert np.isfinite(np.float32(check_voxel_size(size)) ** 3)
    for size in (1e-13, 1e13, 5e-324, 1e308):
        with pytest.raises(InputError, match="between 1e-12 and 1e\\+12 m"):
            check_voxel_size(size)


@pytest.mark.parametrize("size", [True, 2, 2.5, 1e308])
def test_windows_are_odd(size):
    with pytest.raises(InputError, match="odd whole number"):
        check_odd_window("size", size)
    assert check_odd_window("size", np.int32(7)) == 7


@pytest.mark.parametrize("value", [True, -1, 1.5, np.nan, np.inf, "3", None])
def test_counts_are_whole_numbers(value):
    with pytest.raises(InputError, match="max_virtual must be a whole number, 0 or more, got"):
        check_count("max_virtual", value)
    assert check_count("max_virtual", np.int64(3)) == 3


def test_grids_have_three_axes_on_host_and_device():
    for occupied in (np.ones((3, 3), bool), jnp.ones((3, 3), bool)):
        with pytest.raises(InputError, match="occupied must have three axes"):
            check_three_axes("occupied", occupied.shape)


@pytest.mark.parametrize("value", ["best", "", None, 3, np.zeros(2), ["keep"], "x" * 10_000])
def test_a_choice_is_one_of_the_words(value):
    with pytest.raises(InputError, match="rule must be one of 'keep', 'paper', got") as caught:
        check_choice("rule", value, ("keep", "paper"))
    assert len(str(caught.value)) < 250


def _moved(distance):
    T = np.eye(4)
    T[1, 3] = distance
    return T


NO_POSES = {
    "text": ("pose", "matrix of numbers"),
    "ragged": ([[1.0], [1.0, 2.0]], "matrix of numbers"),
    "flat": (np.zeros(16), "got shape"),
    "huge rotation": (np.eye(4) * 1e300, "rigid"),
    "scale": (np.diag([2.0, 2.0, 2.0, 1.0]), "rigid"),
    "mirror": (np.diag([1.0, 1.0, -1.0, 1.0]), "rigid"),
    "NaN": (_moved(np.nan), "rigid"),
    "infinite": (_moved(-np.inf), "rigid"),
    "far": (_moved(1e30), "less than 1e.12 m"),
    "beyond float32": (_moved(-1e300), "less than 1e.12 m"),
}


@pytest.mark.parametrize("case", NO_POSES)
def test_what_is_no_pose_is_refused_on_host_and_device(case):
    T, words = NO_POSES[case]
    with pytest.raises(InputError, match=f"T_a_b must .*{words}"):
        check_pose("T_a_b", T)
    if isinstance(T, np.ndarray):
        with np.errstate(over="ignore"), pytest.raises(InputError, match="T_a_b must"):
            check_pose("T_a_b", jnp.asarray(T.astype(np.float32)))


def test_values_are_quoted_on_one_line_and_cut():
    assert shown("a\nb") == "'a\\nb'"
    assert "\n" not in shown(np.arange(100).reshape(10, 10))
    assert len(shown("x" * 1_000_000)) < 130


def test_arguments_of_a_wrong_kind_are_refused_in_one_sentence():
    # In a process of its own: here the annotations are checked, before the functions see what they get.
    program = """
import numpy as np, voxjax as vx
from voxjax._checks import check_pose, check_voxel_size
grid = vx.VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3), 0.1)
corners = vx.Corners(
    np.full((2, 3), np.nan, np.float32), np.zeros((2, 3, 3), np.float32), np.ones(2, np.float32),
    np.zeros(2, np.uint8), np.ones(2, bool), np.ones(2, bool), np.int32(2),
)
calls = {
    "occupied must be an array": lambda: vx.box_count([[[1]]]),
    "occupied must be an array,": lambda: vx.classify_voxels([[[True]]]),
    "config must be": lambda: vx.register(grid, grid, config=5),
    "config table 'map' must hold": lambda: vx.register(grid, grid, config={"map": "x" * 10**6}),
    "max_voxels must be": lambda: vx.read_map("a.npz", max_voxels="5"),
    "max_voxels must be a": lambda: vx.read_map("a.npz", max_voxels=float("nan")),
    "max_voxels must be a whole": lambda: vx.read_map("a.npz", max_voxels=-1),
    "path must be": lambda: vx.read_map(None),
    "path must be the": lambda: vx.read_map(b"a.npz"),
    "path must be the name": lambda: vx.write_map(5, grid),
    "corners_a must be Corners": lambda: vx.consistency_graph(np.zeros((2, 3)), corners),
    "min_distance must be": lambda: vx.consistency_graph(corners, corners, min_distance=float("inf")),
    "max_nodes must be": lambda: vx.maximum_common_subgraph(corners, corners, max_nodes=-1),
    "NaN or infinity": lambda: vx.consistency_graph(corners, corners),
    "voxel_size must be": lambda: check_voxel_size(True),
    "T must be": lambda: check_pose("T", np.eye(4) + 0j),
    "points must be": lambda: vx.VoxelGrid.from_points(np.zeros((1, 3), complex), voxel_size=0.1),
    "origin must be": lambda: vx.VoxelGrid(grid.states, np.zeros(3, bool), 0.1),
}
for words, call in calls.items():
    try:
        call()
    except vx.InputError as error:
        assert words in str(error) and len(str(error)) < 400 and "\\n" not in str(error), (words, error)
    else:
        raise AssertionError(words)
"""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", program], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
