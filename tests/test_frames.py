"""Maps far from the origin of their frame: every public function gives what it gives near zero."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles.motions import random_pose
from small_worlds import draw_map, pose
from voxjax import InputError, rigid
from voxjax.frames import check_near, float32_tells, from_local, snapped, to_local
from voxjax.fusion.rules import log_odds_of_states
from voxjax.refinement.residuals.known import CornerPairs

SHIFT = np.array([4e5, 5e6, 3e2])
"""To where coordinates of a national grid lie [m]: whole voxels, so that both lie alike on the lattice of multiples."""
VOXEL = 0.16
T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))


def far(grid, shift=SHIFT):
    return vx.VoxelGrid(grid.states, np.asarray(grid.origin) + shift, grid.voxel_size, grid.log_odds)


def far_pose(T, shift_a=SHIFT, shift_b=SHIFT):
    return from_local(T, np.asarray(shift_a), np.asarray(shift_b))


def check_same_pose(T_far, T, point, shift_a=SHIFT, shift_b=SHIFT):
    """A pose between far frames puts a point of b where the near pose puts it, to a millionth of a metre."""
    assert np.asarray(T_far).dtype == np.float64
    image = T_far[:3, :3] @ (point + shift_b) + T_far[:3, 3]
    np.testing.assert_allclose(image - shift_a, T[:3, :3] @ point + T[:3, 3], rtol=0, atol=1e-6)
    np.testing.assert_allclose(T_far[:3, :3], T[:3, :3], rtol=0, atol=1e-12)


def check_same_grid(grid_far, grid, shift=SHIFT):
    np.testing.assert_array_equal(grid_far.states, grid.states)
    np.testing.assert_allclose(grid_far.origin - shift, grid.origin, rtol=0, atol=1e-8)
    assert (grid_far.log_odds is None) == (grid.log_odds is None)
    if grid.log_odds is not None:
        np.testing.assert_array_equal(grid_far.log_odds, grid.log_odds)


@pytest.fixture(scope="module")
def maps():
    """Two overlapping parts of a building in two frames, the true pose, and the centroid of the second."""
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)), voxel_size=VOXEL)
    b = draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)), voxel_size=VOXEL)
    return a, b, np.linalg.inv(T_MAP_WORLD), b.occupied_points().mean(axis=0)


@pytest.fixture(scope="module")
def with_odds(maps):
    return [
        vx.VoxelGrid(m.states, m.origin, m.voxel_size, log_odds_of_states(jnp.asarray(m.states)))
        for m in maps[:2]
    ]


def test_local_poses_come_back_and_move_the_same_points():
    rng = np.random.default_rng(0)
    T = np.stack([random_pose(rng) for _ in range(5)])
    a, b = rng.normal(size=(2, 3)) * SHIFT
    local = to_local(T, a, b)
    np.testing.assert_allclose(from_local(local, a, b), T, atol=1e-7)
    points = rng.normal(size=(7, 3))
    for each, own in zip(local, T, strict=True):
        moved = (points + b) @ own[:3, :3].T + own[:3, 3]
        np.testing.assert_allclose(points @ each[:3, :3].T + each[:3, 3] + a, moved, rtol=0, atol=1e-8)


@pytest.mark.parametrize("change", [to_local, from_local])
@pytest.mark.parametrize("odd", [np.nan, np.inf])
def test_poses_and_places_that_are_none_are_refused(change, odd):
    for number, name in enumerate(("T_a_b", "origin_a", "origin_b")):
        given = [np.eye(4), np.zeros(3), np.zeros(3)]
        given[number][..., 0] = odd
        with pytest.raises(InputError, match=f"{name} must be finite numbers, got"):
            change(*given)


def test_a_rotation_of_float32_becomes_one_that_its_transpose_inverts():
    T = random_pose(np.random.default_rng(1)).astype(np.float32)
    own = from_local(T, SHIFT, SHIFT)
    image = own[:3, :3] @ SHIFT + own[:3, 3]
    there_and_back = rigid.inverse(own)[:3, :3] @ image + rigid.inverse(own)[:3, 3]
    np.testing.assert_allclose(there_and_back, SHIFT, rtol=0, atol=1e-7)
    np.testing.assert_allclose(image - SHIFT, T[:3, 3], rtol=0, atol=1e-7)


def test_snapped_translations_forget_what_float64_rounds_far_out():
    T = np.eye(4)
    T[:3, 3] = [0.3, -7.1, 2.0]
    noisy = T.copy()
    noisy[:3, 3] += (T[:3, 3] + SHIFT) - SHIFT - T[:3, 3]
    assert not np.array_equal(noisy, T)
    np.testing.assert_array_equal(snapped(noisy, 0.1), snapped(T, 0.1))
    assert np.abs(snapped(T, 0.1) - T).max() <= 0.1 / 2**17


def test_what_float32_cannot_tell_apart_is_refused_with_the_local_origin_to_take():
    low, high = np.zeros(3), np.array([1.0, 2.0, 8000.0])
    check_near("the map", low, high, 0.1, "move it")
    with pytest.raises(
        vx.InputError, match=r"the map with voxels of 0\.01 m reaches 8000 m .* move it, with .*4000"
    ):
        check_near("the map", low, high, 0.01, "move it")
    for bad in (np.nan, np.inf, 1e300):
        with pytest.raises(vx.InputError, match="the map with voxels"):
            check_near("the map", low, np.array([0.0, bad, 0.0]), 0.1, "move it")


def test_a_local_grid_is_the_same_in_every_frame(maps):
    near, place = maps[0].localized()
    far_local, far_place = far(maps[0]).localized()
    np.testing.assert_array_equal(near.origin, far_local.origin)
    np.testing.assert_allclose(far_place - place, SHIFT, rtol=0, atol=1e-8)
    assert near.states is maps[0].states
    np.testing.assert_allclose(near.occupied_points() + place, maps[0].occupied_points(), atol=1e-12)
    again, zero = near.localized()
    np.testing.assert_array_equal(again.origin, near.origin)
    np.testing.assert_array_equal(zero, np.zeros(3))


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_registration(maps, preset):
    a, b, _, point = maps
    near = vx.register(a, b, preset=preset)
    # Each map lies far out in a frame of its own.
    other = SHIFT[[1, 0, 2]] * [-1, 1, 1]
    found = vx.register(far(a), far(b, other), preset=preset)
    assert (found.verdict, found.confidence) == (near.verdict, near.confidence)
    assert len(found.hypotheses) == len(near.hypotheses)
    for each, expected in zip(found.hypotheses, near.hypotheses, strict=True):
        check_same_pose(each.T_a_b, expected.T_a_b, point, shift_b=other)
        assert each.score == expected.score
    check_same_pose(found.T_a_b, near.T_a_b, point, shift_b=other)
    np.testing.assert_array_equal(found.covariance, near.covariance)


def test_guesses(maps):
    a, b, T, point = maps
    only = {"source": {"exhaustive": False, "corners": False, "subgraph": False, "descriptors": False}}
    options = {"guess_uncertainty": (0.5, 0.2), "config": only}
    near = vx.register(a, b, init_guess=T, **options)
    found = vx.register(far(a), far(b), init_guess=far_pose(T), **options)
    assert near.hypotheses[0].source == "guess"
    check_same_pose(found.T_a_b, near.T_a_b, point)


def test_merging(maps):
    a, b, _, _ = maps
    near, found = vx.merge([a, b]), vx.merge([far(a), far(b)])
    assert near.status == found.status == "merged"
    check_same_grid(found.grid, near.grid)
    np.testing.assert_array_equal(found.poses[0], np.eye(4))
    assert found.poses[1] is not None
    assert found.poses[1].dtype == np.float64
    batch = vx.register_batch([(far(a), far(b))])[0]
    np.testing.assert_array_equal(batch.T_a_b, found.pairs[0][2].T_a_b)


def test_corners_and_their_graph(maps):
    a, b, _, _ = maps
    for preset in ("default", "paper"):
        near, found = vx.detect_corners(a, preset=preset), vx.detect_corners(far(a), preset=preset)
        np.testing.assert_array_equal(found.mask, near.mask)
        listed = np.asarray(near.mask)
        gap = np.asarray(found.position)[listed] - SHIFT - np.asarray(near.position)[listed]
        assert np.abs(gap).max() < 1e-8
        np.testing.assert_array_equal(found.normals, near.normals)
    corners, far_corners = [[vx.detect_corners(move(m)) for m in (a, b)] for move in (lambda m: m, far)]
    # Distances that differ by the tolerance to the last digit may fall on either side of it.
    graph, far_graph = vx.consistency_graph(*corners), vx.consistency_graph(*far_corners)
    assert np.count_nonzero(graph.adjacency != far_graph.adjacency) <= 2e-4 * graph.adjacency.size
    for method in ("clique", "backtracking"):
        near, found = (
            vx.maximum_common_subgraph(*each, method=method, early_transform=method == "backtracking")
            for each in (corners, far_corners)
        )
        np.testing.assert_array_equal(found.associations, near.associations)


def test_refinement(maps):
    a, b, T, point = maps
    options = {"max_distance": VOXEL, "num_points": 1024}
    near = vx.refine(a, b, T, **options)
    found = vx.refine(far(a), far(b), far_pose(T), **options)
    check_same_pose(found.T_a_b, near.T_a_b, point)
    np.testing.assert_array_equal(found.covariance, near.covariance)
    several = vx.refine(far(a), far(b), np.stack([far_pose(T)] * 2), **options)
    for each in several.T_a_b:
        check_same_pose(each, near.T_a_b, point)


def test_joint_refinement(maps):
    a, b, T, point = maps
    options = {"max_distance": VOXEL, "num_points": 1024}
    near = vx.refine_joint([a, b], [np.eye(4), T], **options)
    found = vx.refine_joint([far(a), far(b)], [np.eye(4), far_pose(T)], **options)
    np.testing.assert_array_equal(found.poses[0], np.eye(4))
    check_same_pose(found.poses[1], near.poses[1], point)
    np.testing.assert_array_equal(found.covariance, near.covariance)


@pytest.mark.parametrize("interpolation", ["nearest", "trilinear"])
def test_fusion(with_odds, maps, interpolation):
    a, b = with_odds
    near = vx.fuse([a, b], [np.eye(4), maps[2]], interpolation=interpolation)
    found = vx.fuse([far(a), far(b)], [np.eye(4), far_pose(maps[2])], interpolation=interpolation)
    check_same_grid(found, near)
    there = vx.fuse([a, b], [from_local(T, SHIFT, np.zeros(3)) for T in (np.eye(4), maps[2])])
    check_same_grid(there, vx.fuse([a, b], [np.eye(4), maps[2]]))


def test_fusion_with_poses_of_float32_about_far_origins(maps):
    """A rotation that is orthonormal to 1e-7 must not move a map that lies 5,000 km away."""
    a, b, T, point = maps
    rough = to_local(T, np.zeros(3), -SHIFT)
    rough[:3, :3] = T[:3, :3].astype(np.float32)
    # The translation belongs to this rotation: together they put the map where it is near zero.
    rough[:3, 3] = T[:3, :3] @ point + T[:3, 3] - rough[:3, :3] @ (point + SHIFT)
    near = vx.fuse([a, b], [np.eye(4), T])
    found = vx.fuse([a, far(b)], [np.eye(4), rough])
    assert np.count_nonzero(found.states != near.states) < 1e-3 * near.num_occupied


def test_moving_and_changing_the_resolution(with_odds, maps):
    a = with_odds[0]
    check_same_grid(far(a).transformed(far_pose(maps[2])), a.transformed(maps[2]))
    # The shift is a whole multiple of these, too.
    for size in (0.2, VOXEL / 2):
        check_same_grid(far(a).with_voxel_size(size), a.with_voxel_size(size))
    check_same_grid(far(a).crop_to_known(), a.crop_to_known())


def test_grids_of_points(maps):
    points = maps[0].occupied_points()
    check_same_grid(
        vx.VoxelGrid.from_points(points + SHIFT, voxel_size=VOXEL),
        vx.VoxelGrid.from_points(points, voxel_size=VOXEL),
    )
    # No ray passes through an edge of voxels, where rounding decides.
    sensor = np.array([1.234, 1.345, 1.456])
    check_same_grid(
        vx.VoxelGrid.from_points(points + SHIFT, voxel_size=VOXEL, sensor_origins=sensor + SHIFT),
        vx.VoxelGrid.from_points(points, voxel_size=VOXEL, sensor_origins=sensor),
    )
    index = maps[0].occupied_index()
    np.testing.assert_array_equal(far(maps[0]).index_from_world(points + SHIFT), index)


@pytest.mark.parametrize("ending", [".npz", ".ply"])
def test_files_hold_far_maps(with_odds, tmp_path, ending):
    grid = far(with_odds[0])
    path = tmp_path / f"far{ending}"
    vx.write_map(path, grid)
    if ending == ".npz":
        assert vx.read_map(path) == grid
    else:
        back = vx.read_map(path, voxel_size=VOXEL)
        np.testing.assert_allclose(back.occupied_points(), grid.occupied_points(), rtol=0, atol=1e-8)


@pytest.mark.parametrize("ending", [".bt", ".ot"])
def test_what_octomap_files_cannot_hold_is_said(maps, tmp_path, ending):
    with pytest.raises(vx.InputError, match=r"reach 32768 voxels from the frame's origin.*use \.npz"):
        vx.write_map(tmp_path / f"far{ending}", far(maps[0]))
    # 1 m voxels of a site some kilometres away fit.
    grid = vx.VoxelGrid(maps[0].states, [5000.0, -7000.0, 300.0], 1.0)
    vx.write_map(tmp_path / f"near{ending}", grid)
    assert vx.read_map(tmp_path / f"near{ending}").crop_to_known().shape == grid.crop_to_known().shape


def test_under_transformations_a_far_frame_is_refused_by_a_sentence_that_names_the_local_origin(
    maps, with_odds
):
    a, b, T, _ = maps
    middle = r"give grid\.localized\(\), with the local origin \[40000\d\.\d"
    far_a, far_b = far(a), far(b)

    def refined(start):
        return vx.refine(far_a, far_b, start).T_a_b

    with pytest.raises(vx.InputError, match=middle):
        jax.jit(refined)(jnp.asarray(T, jnp.float32))
    # The way out of that: near zero the sentence names what can be traced.
    with pytest.raises(
        vx.InputError, match=r"make a voxjax\.refinement\.problems\.pair\.pose_problem before"
    ):
        jax.jit(lambda start: vx.refine(a, b, start).T_a_b)(jnp.asarray(T, jnp.float32))
    slopes = jax.jacfwd(lambda start: vx.refine(a, b, start).T_a_b)(jnp.asarray(T, jnp.float32))
    np.testing.assert_array_equal(slopes, np.zeros((4, 4, 4, 4)))  # the solution does not depend on its start
    points = np.zeros((3, 3), np.float32)
    term = CornerPairs(of_a=points, of_b=points, share=np.ones(3, np.float32))
    with pytest.raises(vx.InputError, match=middle):
        vx.refine(far_a, far_b, T, terms=[term])
    far_odds = far(with_odds[1])

    def fused(pose):
        grids = [far(with_odds[0]), far_odds]
        poses = [jnp.eye(4, dtype=jnp.float32), pose]
        return vx.fuse(grids, poses, interpolation="trilinear", onto=far_a).log_odds

    with pytest.raises(vx.InputError, match=r"give grid\.localized"):
        jax.jit(fused)(jnp.asarray(T, jnp.float32))


def test_an_origin_that_jax_has_rounded_is_refused(maps):
    """Moving a whole map to a device makes its origin float32, and the map half a metre off."""
    moved = jax.device_put(far(maps[0]))
    sentence = r"{} with voxels .* JAX has rounded its origin; give JAX grid\.localized\(\)"
    with pytest.raises(vx.InputError, match=sentence.format(r"grids\[0\]")):
        vx.fuse([moved], [np.eye(4)])
    with pytest.raises(vx.InputError, match=sentence.format("b")):
        vx.register(maps[0], moved)
    T = far_pose(maps[2])
    with pytest.raises(vx.InputError, match=sentence.format("a")):
        vx.refine(moved, far(maps[1]), T)
    with pytest.raises(vx.InputError, match=sentence.format(r"grids\[0\]")):
        vx.refine_joint([moved, far(maps[1])], [np.eye(4), T])
    # Near zero nothing is lost.
    near = jax.device_put(maps[0])
    assert vx.fuse([near], [np.eye(4)]) == vx.fuse([maps[0]], [np.eye(4)])


def test_float32_tells_places_apart_as_far_as_a_hundredth_of_a_voxel():
    rng = np.random.default_rng(0)
    for farthest in (10.0, 5e3, 3e4, 5e6):
        places = rng.uniform(0.5 * farthest, farthest, 4000)
        error = np.abs(places.astype(np.float32).astype(np.float64) - places).max()
        for voxel_size in (1e-3, 0.05, 0.4, 20.0):
            if float32_tells(farthest, voxel_size):
                assert error <= voxel_size / 100
            else:
                assert error > voxel_size / 500
    assert not float32_tells(np.nan, 1.0)
