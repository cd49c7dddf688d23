"""Fusion of grids: places, laws, voxel sizes and refusals."""

import itertools

import numpy as np
import pytest

import voxjax as vx
from oracles import fusion as oracle
from oracles.motions import pose_of, turned
from voxjax import InputError, VoxelGrid
from voxjax.fusion.fuse import fuse_memory
from voxjax.fusion.nearest import plan_fusion

SIZE = 0.1
I = np.eye(4)
RULES = ["paper", "keep", "log_odds"]


def make_grid(seed=0, shape=(6, 5, 4), low=(0, 0, 0), with_log_odds=False) -> VoxelGrid:
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 3, shape).astype(np.uint8)
    values = rng.uniform(0.1, 1.5, shape).astype(np.float32)
    log_odds = np.array([0, -1, 1], np.float32)[states] * values if with_log_odds else None
    return VoxelGrid(states, np.asarray(low) * SIZE, SIZE, log_odds)


def pose(angle=0.4, shift=(0.3, -1.0, 0.2)) -> np.ndarray:
    return turned("zyx", (angle, 0.2, -0.1), shift)


@pytest.mark.parametrize("rule", RULES)
def test_a_map_at_identity_is_copied_voxel_for_voxel(rule):
    grid = make_grid(low=(-3, 17, 2), with_log_odds=True)
    fused = vx.fuse([grid], [I], rule=rule)
    np.testing.assert_array_equal(fused.states, grid.states)
    np.testing.assert_array_equal(fused.origin, grid.origin)
    if rule == "log_odds":
        assert fused == grid


@pytest.mark.parametrize("rule", RULES)
def test_shifted_maps_fuse_voxel_by_voxel(rule):
    a, b = make_grid(1, with_log_odds=True), make_grid(2, with_log_odds=True)
    shift = np.array([2, -1, 3])
    T = pose_of(translation=shift * SIZE)
    fused = vx.fuse([a, b], [I, T], rule=rule)
    np.testing.assert_allclose(fused.origin, [0, -SIZE, 0], atol=1e-6)
    assert fused.shape == (8, 6, 7)
    for index in np.ndindex(*fused.shape):
        cell = np.array(index) + [0, -1, 0]
        states, covered, odds = [], [], []
        for grid, at in ((a, cell), (b, cell - shift)):
            inside = bool((at >= 0).all() and (at < grid.shape).all())
            covered.append(inside)
            states.append(int(grid.states[tuple(at)]) if inside else 0)
            odds.append(float(np.asarray(grid.log_odds)[tuple(at)]) if inside else 0.0)
        if rule == "paper":
            assert fused.states[index] == oracle.paper(states, covered)
        elif rule == "keep":
            assert fused.states[index] == oracle.keep(states)
        else:
            state, value = oracle.log_odds(states, odds)
            assert fused.states[index] == state
            assert np.asarray(fused.log_odds)[index] == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize("rule", RULES)
def test_the_order_of_two_maps_does_not_matter(rule):
    a, b = make_grid(1, with_log_odds=True), make_grid(2, (4, 7, 5), with_log_odds=True)
    assert vx.fuse([a, b], [I, pose()], rule=rule) == vx.fuse([b, a], [pose(), I], rule=rule)


@pytest.mark.parametrize("shifts", [(0, 0, 0, 0), (0, 1, -1, 2)])
def test_the_order_of_many_maps_does_not_matter_to_the_bit(shifts):
    """Sums of log-odds are rounded as they are ordered; those about zero decide states."""
    grids = [make_grid(seed, with_log_odds=True) for seed in range(4)]
    poses = [pose_of(translation=(shift * SIZE, 0, 0)) for shift in shifts]
    one = vx.fuse(grids, poses, rule="log_odds")
    for order in itertools.permutations(range(4)):
        other = vx.fuse([grids[k] for k in order], [poses[k] for k in order], rule="log_odds")
        np.testing.assert_array_equal(other.log_odds, one.log_odds)
        np.testing.assert_array_equal(other.states, one.states)


@pytest.mark.parametrize("rule", ["paper", "keep"])
def test_a_map_fused_with_itself_is_itself(rule):
    grid = make_grid()
    assert vx.fuse([grid, grid, grid], [I, I, I], rule=rule) == grid


def test_keep_of_three_maps_is_the_fold_of_pairs():
    grids = [make_grid(seed, low=(seed, 0, -seed)) for seed in range(3)]
    pair = vx.fuse(grids[:2], [I, I], rule="keep")
    assert vx.fuse([pair, grids[2]], [I, I], rule="keep") == vx.fuse(grids, [I, I, I], rule="keep")


def test_a_map_and_its_moved_copy_agree_again_when_moved_back():
    grid = make_grid(3, (12, 11, 10))
    T = turned("z", 90, (0.7, -0.4, 1.2), degrees=True)
    assert vx.fuse([grid, grid.transformed(T)], [I, np.linalg.inv(T)], rule="keep") == grid


def test_without_a_rule_log_odds_are_added_if_all_maps_have_them():
    with_odds, without = make_grid(1, with_log_odds=True), make_grid(2)
    assert vx.fuse([with_odds, with_odds], [I, I]).log_odds is not None
    assert vx.fuse([with_odds, without], [I, I]) == vx.fuse([with_odds, without], [I, I], rule="keep")


def test_maps_without_log_odds_count_as_one_observation():
    occupied = VoxelGrid(np.full((1, 1, 1), 2, np.uint8), np.zeros(3), SIZE)
    free = VoxelGrid(np.full((1, 1, 1), 1, np.uint8), np.zeros(3), SIZE)
    fused = vx.fuse([occupied, free], [I, I], rule="log_odds")
    assert float(np.asarray(fused.log_odds)[0, 0, 0]) == pytest.approx(0.45, abs=1e-6)
    assert vx.fuse([occupied, free, free, free], [I] * 4, rule="log_odds").num_free == 1


def test_the_finest_voxel_size_wins_and_the_order_does_not_matter():
    coarse, fine = make_grid(1).with_voxel_size(0.2), make_grid(2)
    fused = vx.fuse([coarse, fine], [I, I], rule="keep")
    assert fused.voxel_size == SIZE
    assert fused == vx.fuse([fine, coarse], [I, I], rule="keep")
    assert fused == vx.fuse([coarse.with_voxel_size(SIZE), fine], [I, I], rule="keep")


def test_a_coarser_result_loses_no_thin_wall():
    states = np.ones((8, 8, 8), np.uint8)
    states[3] = 2
    fused = vx.fuse([VoxelGrid(states, np.zeros(3), SIZE)], [I], rule="keep", voxel_size=0.4)
    np.testing.assert_array_equal(fused.states[0], np.full((2, 2), 2))
    np.testing.assert_array_equal(fused.states[1], np.full((2, 2), 1))


def test_the_result_can_be_written_as_an_octomap_file(tmp_path):
    off_lattice = VoxelGrid(make_grid().states, [0.033, 0.0, -0.27], SIZE)
    fused = vx.fuse([off_lattice, make_grid(2)], [pose(), I])
    vx.write_map(tmp_path / "f.bt", fused)
    assert vx.read_map(tmp_path / "f.bt") == fused.crop_to_known()


@pytest.mark.parametrize("rule", RULES)
def test_far_apart_maps_in_several_chunks_keep_all_their_voxels(rule):
    a, b = make_grid(1, with_log_odds=True), make_grid(2, with_log_odds=True)
    T = pose_of(translation=(15.0, 14.0, 13.0))
    fused = vx.fuse([a, b], [I, T], rule=rule)
    assert fused.states.size > 1 << 21
    assert fused.num_occupied == a.num_occupied + b.num_occupied
    assert fused.num_free == a.num_free + b.num_free


def test_maps_of_nothing_fuse_to_nothing():
    empty = VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), SIZE)
    assert vx.fuse([empty, empty], [I, pose()]).num_occupied == 0
    assert vx.fuse([empty], [pose()]).shape == (1, 1, 1)
    grid = make_grid()
    assert vx.fuse([grid, empty], [I, pose()], rule="keep") == grid


@pytest.mark.parametrize("kind", ["dense", "blocks"])
@pytest.mark.parametrize("angle", [0.0, 90.0, 17.0])
def test_a_map_of_nothing_adds_nothing_wherever_it_lies(tmp_path, kind, angle):
    grid, far = make_grid(), np.array([4.5e5, 5.4e6, 0.0])
    empty = VoxelGrid(np.zeros((6, 6, 6), np.uint8), far, SIZE)
    if kind == "blocks":
        empty = VoxelGrid(empty.state_blocks(), far, SIZE)
    poses = [I, turned("z", np.radians(angle), (1.0, 2.0, 3.0))]
    for rule in ("paper", "keep", "log_odds"):
        assert vx.fuse([grid, empty], poses, rule=rule) == vx.fuse([grid], poses[:1], rule=rule)
    assert vx.fuse([grid, empty], poses, rule="keep", out=tmp_path / "m.zarr") == grid
    soft = vx.fuse([grid, empty], poses, interpolation="trilinear")
    assert soft == vx.fuse([grid], poses[:1], interpolation="trilinear")


def test_misuse_is_refused_in_one_sentence():
    grid = make_grid()
    far = np.eye(4)
    far[0, 3] = far[1, 3] = far[2, 3] = 1e6
    flip = np.diag([1.0, 1.0, -1.0, 1.0])
    for call, sentence in (
        (lambda: vx.fuse([], []), "at least one map"),
        (lambda: vx.fuse([grid], []), "one pose a map"),
        (lambda: vx.fuse([grid, grid], [I, None]), r"poses\[1\] is None"),
        (lambda: vx.fuse([grid], [flip]), r"poses\[0\] must be a rigid transform"),
        (lambda: vx.fuse([grid], [I], rule="mean"), "rule must be one of"),
        (lambda: vx.fuse([grid, grid], [I, far]), "check the poses"),
        (lambda: vx.fuse([grid], [I], voxel_size=0.0), "voxel_size"),
    ):
        with pytest.raises(InputError, match=sentence):
            call()


@pytest.mark.parametrize("distance", [1e11, 1e20, 1e30, 1e300])
@pytest.mark.parametrize("turn", [I, pose(0.4, (0.0, 0.0, 0.0))], ids=["straight", "turned"])
@pytest.mark.parametrize("interpolation", ["nearest", "trilinear"])
def test_a_pose_that_overflows_is_refused_and_no_map_is_left_out(distance, turn, interpolation):
    grid, far = make_grid(with_log_odds=True), np.array(turn)
    far[1, 3] = distance
    with pytest.raises(InputError, match=r"check the poses|poses\[1\] must move by less than"):
        vx.fuse([grid, grid], [I, far], interpolation=interpolation)
    # So it is without another map, however small its voxels.
    far[1, 3] = 1e11
    fine = VoxelGrid(np.asarray(grid.states), np.zeros(3), 1e-6)
    with pytest.raises(InputError, match="check the poses, or choose an origin near"):
        vx.fuse([fine], [far])


@pytest.mark.parametrize("rule", ["keep", "log_odds"])
def test_a_fused_map_that_memory_will_not_hold_is_refused_before_it_is_made(monkeypatch, rule):
    near, far = VoxelGrid(np.ones((4, 4, 4), np.uint8), np.zeros(3), SIZE), np.eye(4)
    far[:3, 3] = 60 * SIZE
    plan = plan_fusion([near, near], [I, far], rule=rule, voxel_size=SIZE)
    assert plan is not None
    num_blocks = sum(plan.count(*window)[1] for window in plan.windows())
    assert 2 <= num_blocks <= 64  # of the 512 of the box
    need = fuse_memory(num_blocks, has_log_odds=rule == "log_odds")
    monkeypatch.setenv("VOXJAX_MEMORY", str(1.01 * need / 1e9))
    assert vx.fuse([near, near], [I, far], rule=rule).shape == (64, 64, 64)
    monkeypatch.setenv("VOXJAX_MEMORY", str(0.99 * need / 1e9))
    with pytest.raises(InputError, match=r"64 x 64 x 64 voxels of 0\.1 m needs about .* larger voxel_size"):
        vx.fuse([near, near], [I, far], rule=rule)
