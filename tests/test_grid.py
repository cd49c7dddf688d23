"""`VoxelGrid`: places of voxels, cropping, motions, checks and text."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.view import draw_grid


def make_grid(seed=0, shape=(5, 6, 7), with_log_odds=False) -> VoxelGrid:
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 3, shape).astype(np.uint8)
    log_odds = rng.normal(size=shape).astype(np.float32) if with_log_odds else None
    return VoxelGrid(states, [0.2, -1.4, 3.0], 0.2, log_odds)


def test_the_origin_is_the_outer_corner_and_centres_lie_half_a_voxel_further():
    grid = VoxelGrid(np.zeros((2, 2, 2), np.uint8), [1.0, 2.0, 3.0], 0.5)
    np.testing.assert_array_equal(grid.world_from_index(np.array([0, 1, 0])), [1.25, 2.75, 3.25])
    low, high = grid.extent
    np.testing.assert_array_equal(low, [1, 2, 3])
    np.testing.assert_array_equal(high, [2, 3, 4])
    low -= 1.0  # a box of one's own, which the map does not follow
    np.testing.assert_array_equal(grid.origin, [1, 2, 3])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_the_voxel_of_a_centre_is_the_voxel(seed):
    rng = np.random.default_rng(seed)
    grid = VoxelGrid(np.zeros((3, 3, 3), np.uint8), rng.uniform(-100, 100, 3), float(rng.uniform(0.02, 2)))
    index = rng.integers(-500, 500, (20, 3)).astype(np.int32)
    np.testing.assert_array_equal(grid.index_from_world(grid.world_from_index(index)), index)


def test_occupied_voxels_are_listed_in_lexicographic_order():
    grid = make_grid()
    index = grid.occupied_index()
    assert index.dtype == np.int32
    assert len(index) == grid.num_occupied == int((np.asarray(grid.states) == 2).sum())
    assert index.tolist() == sorted(index.tolist())
    np.testing.assert_array_equal(grid.occupied_points(), grid.world_from_index(index))
    assert grid.num_free == int((np.asarray(grid.states) == 1).sum())


@pytest.mark.parametrize("margin", [0, 1, 9])
def test_cropping_keeps_every_known_voxel_in_its_place(margin):
    states = np.zeros((9, 8, 7), np.uint8)
    states[3:6, 2:3, 4:6] = np.random.default_rng(0).integers(1, 3, (3, 1, 2))
    log_odds = states.astype(np.float32)
    grid = VoxelGrid(states, [0.2, -1.4, 3.0], 0.2, log_odds)
    cropped = grid.crop_to_known(margin)
    assert cropped.shape == {0: (3, 1, 2), 1: (5, 3, 4), 9: (9, 8, 7)}[margin]
    np.testing.assert_allclose(cropped.occupied_points(), grid.occupied_points(), atol=1e-6)
    assert (cropped.num_free, cropped.num_occupied) == (grid.num_free, grid.num_occupied)
    np.testing.assert_array_equal(cropped.log_odds, cropped.states)


def test_a_margin_below_zero_is_refused():
    with pytest.raises(InputError, match="margin must be a whole number, 0 or more, got -1"):
        make_grid().crop_to_known(-1)


@pytest.mark.parametrize("shape", [(4, 3, 2), (0, 3, 2), (1, 1, 1)])
def test_a_map_of_nothing_crops_to_one_unknown_voxel(shape):
    cropped = VoxelGrid(np.zeros(shape, np.uint8), [1.0, 2.0, 3.0], 0.1).crop_to_known()
    assert cropped.shape == (1, 1, 1)
    assert cropped.num_occupied == cropped.num_free == 0
    np.testing.assert_array_equal(cropped.origin, [1, 2, 3])


@pytest.mark.parametrize("with_log_odds", [False, True])
def test_the_identity_moves_nothing(with_log_odds):
    grid = make_grid(with_log_odds=with_log_odds)
    assert grid.transformed(np.eye(4)) == grid


def test_whole_voxel_shifts_move_the_origin_only():
    grid = make_grid(with_log_odds=True)
    T = np.eye(4)
    T[:3, 3] = [0.4, -2.0, 0.2]
    moved = grid.transformed(T)
    np.testing.assert_array_equal(moved.states, grid.states)
    np.testing.assert_array_equal(moved.log_odds, grid.log_odds)
    np.testing.assert_allclose(moved.origin, np.asarray(grid.origin) + T[:3, 3], atol=1e-6)


def test_moved_voxels_lie_where_the_pose_takes_their_centres():
    grid = make_grid(3, (12, 13, 14))
    c, s = np.cos(0.7), np.sin(0.7)
    T = np.array([[c, -s, 0, 1], [s, c, 0, 2], [0, 0, 1, 0.1], [0, 0, 0, 1]])
    moved = grid.transformed(T)
    expected = grid.occupied_points() @ T[:3, :3].T + T[:3, 3]
    from_moved = moved.occupied_points()
    gap = np.linalg.norm(from_moved[:, None] - expected[None], axis=2).min(axis=1)
    assert gap.max() <= 0.1 * np.sqrt(3) + 1e-5  # half a voxel along each axis of the source
    assert len(from_moved) == pytest.approx(len(expected), rel=0.05)


def test_change_of_resolution_keeps_the_places():
    grid = make_grid()
    assert grid.with_voxel_size(0.2) is grid
    assert grid.with_voxel_size(0.1).with_voxel_size(0.2) == grid
    coarse = grid.with_voxel_size(0.4)
    parts = {tuple(i) for i in np.floor(grid.occupied_points() / 0.4 + 1e-6).astype(int).tolist()}
    assert {tuple(i) for i in np.floor(coarse.occupied_points() / 0.4 + 1e-6).astype(int).tolist()} == parts


def test_the_same_voxel_size_moves_a_grid_onto_the_lattice_by_half_a_voxel_at_most():
    grid = VoxelGrid(make_grid().states, [0.05, -1.38, 3.0], 0.2)
    moved = grid.with_voxel_size(0.2)
    np.testing.assert_array_equal(moved.states, grid.states)
    np.testing.assert_allclose(
        np.asarray(moved.origin) / 0.2, np.rint(np.asarray(moved.origin) / 0.2), atol=1e-5
    )
    assert np.abs(np.asarray(moved.origin) - np.asarray(grid.origin)).max() <= 0.1001


@pytest.mark.parametrize("is_sparse", [False, True])
def test_a_placed_map_has_the_same_voxels_at_other_places(is_sparse):
    grid = make_grid(with_log_odds=True)
    if is_sparse:
        grid = VoxelGrid(grid.state_blocks(), grid.origin, grid.voxel_size, grid.log_odds_blocks())
    shift = np.array([4.5e5, 5.4e6, -0.125])
    placed = grid.placed(scale=0.5, shift=shift)
    assert (placed.voxel_size, placed.is_sparse) == (0.1, is_sparse)
    np.testing.assert_array_equal(placed.origin, np.asarray(grid.origin) * 0.5 + shift)
    index = grid.occupied_index()
    np.testing.assert_allclose(
        placed.world_from_index(index), grid.world_from_index(index) * 0.5 + shift, rtol=1e-15
    )
    np.testing.assert_array_equal(placed.states, grid.states)
    np.testing.assert_array_equal(placed.log_odds, grid.log_odds)
    assert grid.placed() == grid
    for options, words in (
        ({"scale": -1.0}, "scale must be a finite number above 0"),
        ({"shift": 1.0}, r"shift must have shape \(3,\)"),
        ({"shift": [0, np.nan, 0]}, "origin must be finite"),
    ):
        with pytest.raises(InputError, match=words):
            grid.placed(**options)  # pyright: ignore[reportArgumentType]


def test_grids_are_equal_when_all_they_hold_is():
    grid = make_grid()
    assert grid == make_grid()
    others = [
        VoxelGrid(np.asarray(grid.states)[:-1], grid.origin, 0.2),
        VoxelGrid(np.roll(np.asarray(grid.states), 1), grid.origin, 0.2),
        VoxelGrid(grid.states, np.asarray(grid.origin) + 1, 0.2),
        VoxelGrid(grid.states, grid.origin, 0.1),
        make_grid(with_log_odds=True),
    ]
    assert all(grid != other for other in others)
    assert grid != "a grid"


def test_the_text_is_one_line_for_a_person():
    text = repr(make_grid(with_log_odds=True))
    assert "\n" not in text
    for part in ("5 x 6 x 7", "0.2 m", "x 0.20..1.20", "occupied", "free", "with log-odds"):
        assert part in text


def test_a_grid_passes_through_jit_with_its_voxel_size_static():
    grid = make_grid(with_log_odds=True)

    @jax.jit
    def shifted(g: VoxelGrid) -> VoxelGrid:
        assert isinstance(g.voxel_size, float)
        return VoxelGrid(g.states, g.origin + jnp.float32(g.voxel_size), g.voxel_size, g.log_odds)

    moved = shifted(grid)
    np.testing.assert_allclose(moved.origin, np.asarray(grid.origin) + 0.2, atol=1e-6)
    np.testing.assert_array_equal(moved.states, grid.states)
    assert moved.num_occupied == grid.num_occupied


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((np.zeros((2, 2), np.uint8), np.zeros(3), 0.1), "three axes"),
        ((np.zeros((2, 2, 2), np.int64), np.zeros(3), 0.1), "must be uint8"),
        ((np.full((2, 2, 2), 3, np.uint8), np.zeros(3), 0.1), "got 3"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(2), 0.1), "origin must have shape"),
        ((np.zeros((2, 2, 2), np.uint8), [0, np.nan, 0], 0.1), "origin must be finite"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(3), 0.0), "voxel_size"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(3), float("inf")), "voxel_size"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(3), 0.1, np.zeros((2, 2, 1))), "log_odds"),
        ((np.zeros((2, 2, 2), np.uint8), [0, 1e300, 0], 0.1), "origin must be finite"),
        ((np.zeros((2, 2, 2), np.uint8), [0, 1e13, 0], 0.1), "within 1e[+]12 m"),
        ((np.zeros((2, 2, 2), np.uint8), ["a", "b", "c"], 0.1), "origin must be an array of numbers"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(3), 1e-300), "between 1e-12 and 1e[+]12 m"),
        ((np.zeros((2, 2, 2), np.uint8), np.zeros(3), 9e11), "reach beyond"),
        ((np.zeros((1, 1, 2), np.uint8), np.zeros(3), 0.1, [[[0.0, np.nan]]]), "log_odds must be finite"),
        ((np.zeros((1, 1, 2), np.uint8), np.zeros(3), 0.1, [[[0.0, -np.inf]]]), "log_odds must be finite"),
        ((np.zeros((1, 1, 2), np.uint8), np.zeros(3), 0.1, [[[0.0, 1e39]]]), "log_odds must be finite"),
        (([[[0], [0, 1]]], np.zeros(3), 0.1), "states must be an array"),
    ],
)
def test_misuse_is_refused_in_one_sentence(arguments, sentence):
    with pytest.raises(InputError, match=sentence):
        VoxelGrid(*arguments)


@pytest.mark.parametrize(
    ("states", "origin", "log_odds", "sentence"),
    [
        ([[[7]]], [0.0, 0.0, 0.0], None, "states must be .* got 7"),
        ([[[1]]], [0.0, np.nan, 0.0], None, "origin must be finite"),
        ([[[1]]], [0.0, 0.0, np.inf], None, "origin must be finite"),
        ([[[1]]], [0.0, 0.0, 0.0], [[[np.nan]]], "log_odds must be finite"),
        ([[[1]]], [0.0, 0.0, 0.0], [[[np.inf]]], "log_odds must be finite"),
    ],
)
def test_device_arrays_are_checked_as_those_of_the_host_are(states, origin, log_odds, sentence):
    odds = None if log_odds is None else jnp.asarray(log_odds, jnp.float32)
    with pytest.raises(InputError, match=sentence):
        VoxelGrid(jnp.asarray(states, jnp.uint8), jnp.asarray(origin, jnp.float32), 0.1, odds)


def test_the_dtype_of_device_arrays_is_checked_also_while_they_are_traced():
    with pytest.raises(InputError, match="must be uint8"):
        VoxelGrid(jnp.ones((2, 2, 2), jnp.int32), np.zeros(3), 0.1)
    with pytest.raises(InputError, match="must be uint8"):
        jax.eval_shape(lambda s: VoxelGrid(s, np.zeros(3), 0.1), jnp.ones((2, 2, 2), jnp.int32))
    assert VoxelGrid(np.ones((2, 2, 2), np.uint8), jnp.ones(3, jnp.int32), 0.1).origin.dtype == np.float64


def test_arrays_that_lie_on_several_devices_are_checked_where_they_lie():
    mesh = jax.make_mesh((2,), ("x",))
    place = jax.NamedSharding(mesh, jax.P("x"))
    states = jax.device_put(np.array([[[1]], [[9]]], np.uint8), place)
    with pytest.raises(InputError, match="got 9"):
        VoxelGrid(states, np.zeros(3), 0.1)
    assert VoxelGrid(jnp.minimum(states, jnp.uint8(2)), np.zeros(3), 0.1).shape == (2, 1, 1)


def test_large_finite_log_odds_are_kept():
    odds = np.full((2, 2, 2), 3e38, np.float32)  # their sum overflows
    assert VoxelGrid(np.ones((2, 2, 2), np.uint8), np.zeros(3), 0.1, odds).log_odds is odds


@pytest.mark.parametrize("voxel_size", [1e-9, 1e-11])
def test_a_resolution_for_which_no_memory_suffices_is_refused_before_the_work(voxel_size):
    with pytest.raises(InputError, match=r"new voxel size .*; choose a larger voxel size"):
        make_grid().with_voxel_size(voxel_size)
    with pytest.raises(InputError, match="give a larger voxel_size"):
        VoxelGrid.from_points([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]], voxel_size=voxel_size)


def test_the_memory_that_is_left_bounds_the_resolution(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.001")
    points = [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]
    assert VoxelGrid.from_points(points, voxel_size=0.05).shape == (21, 41, 61)
    with pytest.raises(InputError, match=r"needs about 0\.00611 GB of memory"):
        VoxelGrid.from_points(points, voxel_size=0.01)
    with pytest.raises(InputError, match=r"new voxel size.* GB of memory"):
        make_grid(with_log_odds=True).with_voxel_size(0.01)
    with pytest.raises(InputError, match="moved map needs about"):
        VoxelGrid(np.ones((100, 100, 101), np.uint8), np.zeros(3), 0.1).transformed(np.eye(4))


@pytest.mark.parametrize("far", [1e13, np.nan, np.inf])
def test_points_without_an_index_are_refused(far):
    with pytest.raises(InputError, match="points must be finite and within"):
        make_grid().index_from_world(np.array([[0.0, far, 0.0]]))
    with pytest.raises(InputError, match=r"points must be finite and within|more than 2"):
        VoxelGrid.from_points([[0.0, far, 0.0]], voxel_size=0.1)


def test_motions_that_go_too_far_are_refused():
    T = np.eye(4)
    for distance in (1e13, 1e30, 1e300):
        T[0, 3] = distance
        with pytest.raises(InputError, match="T must move by less than"):
            make_grid().transformed(T)
    T[0, 3] = 1e11
    fine = VoxelGrid(np.full((1, 1, 1), 2, np.uint8), np.zeros(3), 1e-6)
    with pytest.raises(InputError, match="check the poses, or choose an origin near"):
        fine.transformed(T)


def test_motions_that_are_not_rigid_are_refused():
    for T in (np.eye(3), 2 * np.eye(4), np.diag([1.0, 1.0, -1.0, 1.0]), np.full((4, 4), np.nan)):
        with pytest.raises(InputError, match="T must be a"):
            make_grid().transformed(T)


def test_clouds_become_grids_on_the_lattice():
    grid = vx.VoxelGrid.from_points(np.array([[0.05, 0.05, 0.05], [0.55, -0.25, 0.05]]), voxel_size=0.1)
    assert (grid.num_occupied, grid.num_free) == (2, 0)
    np.testing.assert_allclose(
        sorted(grid.occupied_points().tolist()), [[0.05, 0.05, 0.05], [0.55, -0.25, 0.05]], atol=1e-6
    )
    with pytest.raises(InputError, match="voxel_size"):
        vx.VoxelGrid.from_points(np.zeros((1, 3)), voxel_size=-1.0)


def _room(origin, voxel_size=0.1):
    states = np.ones((24, 22, 20), np.uint8)
    states[[0, -1]] = states[:, [0, -1]] = states[:, :, [0, -1]] = 2
    return VoxelGrid(states, np.full(3, origin), voxel_size)


def test_corners_of_a_map_far_from_the_origin_are_those_of_the_map_near_it():
    near = vx.detect_corners(_room(0.0))
    for shift in (2.0**17, -(2.0**19), 1e9):
        far = vx.detect_corners(_room(shift))
        assert far.num_found == near.num_found == 8
        a, b = (np.asarray(c.position)[np.asarray(c.mask)] for c in (near, far))
        np.testing.assert_allclose(b - shift, a, rtol=0, atol=1e-6)


def test_what_float64_cannot_place_to_within_hundredths_of_a_voxel_is_refused(tmp_path):
    grid = VoxelGrid(np.full((3, 3, 3), 2, np.uint8), np.zeros(3), 0.001)
    far = np.eye(4)
    far[0, 3] = 0.7e12
    far_grid = VoxelGrid(grid.states, far[:3, 3], 0.001)
    vx.write_map(tmp_path / "far.npz", far_grid)
    for make in (
        lambda: VoxelGrid.from_points(far[None, :3, 3], voxel_size=0.001),
        lambda: grid.transformed(far),
        lambda: far_grid.with_voxel_size(0.0005),
        lambda: vx.fuse([grid], [far]),
        lambda: vx.fuse([far_grid], [np.eye(4)]),
        lambda: vx.fuse([grid], [np.eye(4)], interpolation="trilinear", onto=far_grid),
        lambda: vx.read_map(tmp_path / "far.npz"),
    ):
        with pytest.raises(InputError, match=r"placed in steps of 0\.00012 m only"):
            make()


def test_a_step_of_float32_that_is_as_long_as_a_voxel_loses_nothing():
    far = np.eye(4)
    far[0, 3] = 5000000.5
    grid = VoxelGrid(np.full((3, 3, 3), 2, np.uint8), np.zeros(3), 0.5)
    assert grid.transformed(far).origin[0] == vx.fuse([grid], [far]).origin[0] == 5000000.5
    assert VoxelGrid.from_points(far[None, :3, 3], voxel_size=0.5).origin[0] == 5000000.5


@pytest.mark.parametrize("origin", [[0.2, -1.4, 3.0], np.asarray([0.2, -1.4, 3.0], np.float32)])
def test_grids_are_equal_up_to_rounding_of_their_places(origin):
    states = np.ones((2, 2, 2), np.uint8)
    assert VoxelGrid(states, origin, 0.2) == VoxelGrid(states, np.array([1, -7, 15]) * 0.2, 0.2)
    assert VoxelGrid(states, origin, 0.2) != VoxelGrid(states, np.array([1, -7, 15]) * 0.2 + 1e-3, 0.2)


def test_what_takes_much_more_than_a_map_is_held_against_the_memory(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "0.01")
    grid = VoxelGrid(np.full((170, 160, 160), 2, np.uint8), np.zeros(3), 0.1)
    for work in (grid.occupied_index, lambda: vx.detect_corners(grid), lambda: draw_grid(grid)):
        with pytest.raises(InputError, match=r"needs about .* GB of memory"):
            work()
    with pytest.raises(InputError, match="corners in 4,352,000 voxels"):
        vx.detect_corners(grid, preset="paper")


@pytest.mark.parametrize("shape", [(3, 4, 5), (700, 40, 41), (0, 3, 3), (3, 0, 2), (2, 3, 0)])
def test_places_of_occupied_voxels_come_in_blocks_of_planes(shape):
    states = np.random.default_rng(0).integers(0, 3, shape).astype(np.uint8)
    index = VoxelGrid(states, np.zeros(3), 0.1).occupied_index()
    assert index.dtype == np.int32
    np.testing.assert_array_equal(index, np.argwhere(states == 2))


def test_dense_views_of_blocks_are_made_once_where_small_and_cannot_be_written_in_vain():
    states = np.zeros((9, 20, 11), np.uint8)
    states[2:5, 3:17] = 1
    log_odds = np.where(states, np.float32(-0.4), np.float32(0.0))
    grid = VoxelGrid(blocks_of(states), np.zeros(3), 0.1, blocks_of(log_odds))
    assert grid.states is grid.states
    assert grid.log_odds is grid.log_odds
    for values in (grid.states, grid.log_odds):
        assert values is not None
        with pytest.raises(ValueError, match="read-only"):
            values[0, 0, 0] = 1
    own = grid.states.copy()
    own[0, 0, 0] = 2
    assert VoxelGrid(own, grid.origin, 0.1).num_occupied == 1
    # A dense map is what it was given.
    dense = VoxelGrid(own, grid.origin, 0.1)
    dense.states[0, 0, 0] = 1
    assert dense.num_occupied == 0
