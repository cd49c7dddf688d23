"""Fusion block by block gives the bits of fusion over all voxels of the box, at a cost that follows content."""

import itertools
import tracemalloc

import numpy as np
import pytest
from tests import dense_fusion
from tests.ops.blocks.boxes import random_boxes
from tests.stores import stored

import voxjax as vx
from oracles.motions import cube_rotations, pose_of, random_pose, turned
from voxjax import InputError, VoxelGrid
from voxjax.fusion.nearest import plan_fusion
from voxjax.ops.blocks.block_builder import BlockBuilder, blocks_of
from voxjax.ops.blocks.chunked_array import ChunkedArray

SIZE = 0.1
RULES = ["paper", "keep", "log_odds"]
FAR = np.array([4e5, 5e6, 300.0])
CUBE_ROTATIONS = cube_rotations()
ZERO = np.zeros(3)


def make_grid(
    seed, shape=(37, 25, 18), *, size=SIZE, low=(0, 0, 0), frame=ZERO, with_log_odds=True, sparse=False
):
    """A map of boxes of one state, whose log-odds are of one value in most blocks, too."""
    rng = np.random.default_rng(seed)
    states = random_boxes(shape, seed=seed, num_boxes=8)
    log_odds = np.array([0.0, -2.0, 1.5], np.float32)[states]
    # What is not known may have any log-odds.
    odd = rng.random(shape) < 0.002
    log_odds[odd] = rng.normal(size=int(odd.sum()))
    kept = (states, log_odds if with_log_odds else None)
    if sparse:
        kept = tuple(None if v is None else blocks_of(v) for v in kept)
    return VoxelGrid(kept[0], np.asarray(low) * size + frame, size, kept[1])


def assert_same(fused, dense):
    assert fused.is_sparse
    assert fused.shape == dense.shape
    np.testing.assert_array_equal(fused.origin, dense.origin)
    np.testing.assert_array_equal(fused.states, dense.states)
    assert (fused.log_odds is None) == (dense.log_odds is None)
    if dense.log_odds is not None:
        np.testing.assert_array_equal(fused.log_odds, dense.log_odds)
    states = fused.state_blocks()
    assert not states.pool[0].any()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("seed", range(4))
def test_two_maps_at_any_poses_give_the_bits_of_the_dense_way(rule, seed):
    rng = np.random.default_rng(seed)
    # Dense and sparse, beside the lattice, with and without log-odds.
    a = make_grid(seed, sparse=seed % 2 == 0, low=(0.3, 0.0, -2.0))
    b = make_grid(seed + 10, (29, 40, 15), with_log_odds=seed != 3, sparse=seed > 1)
    poses = [random_pose(rng, metres=1.0, degrees=20 if seed else 180) for _ in range(2)]
    fused = vx.fuse([a, b], poses, rule=rule)
    assert_same(fused, dense_fusion.fuse([a, b], poses, rule=rule, voxel_size=SIZE))
    assert fused.num_occupied > 100


@pytest.mark.parametrize("rule", RULES)
def test_three_maps_of_three_voxel_sizes_give_the_bits_of_the_dense_way(rule):
    rng = np.random.default_rng(5)
    grids = [
        make_grid(1),
        make_grid(2, (19, 21, 9), size=0.2),
        make_grid(3, (50, 40, 30), size=0.07, sparse=True),
    ]
    poses = [random_pose(rng, metres=1.5, degrees=30) for _ in grids]
    plan = plan_fusion(grids, poses, rule=rule, voxel_size=0.1)
    assert plan is not None
    # Log-odds of three maps are added in the order that the plan decides.
    fused = vx.fuse(grids, poses, rule=rule, voxel_size=0.1)
    shapes = [(grid if grid.voxel_size >= 0.1 else grid.with_voxel_size(0.1)).shape for grid in grids]
    order = [shapes.index(source.shape) for source in plan.sources]
    dense = dense_fusion.fuse([grids[n] for n in order], [poses[n] for n in order], rule=rule, voxel_size=0.1)
    assert_same(fused, dense)


def test_more_maps_than_a_byte_has_bits_give_the_bits_of_the_dense_way():
    """Which maps reach a block is kept as bits; here some reach none of those that others do."""
    grids = [make_grid(seed, (12, 10, 9)) for seed in range(10)]
    poses = [pose_of(translation=(0.35 * number, 0.1 * (number % 3), 0.0)) for number in range(10)]
    fused = vx.fuse(grids, poses, rule="keep")
    assert_same(fused, dense_fusion.fuse(grids, poses, rule="keep", voxel_size=SIZE))
    assert fused.num_occupied > 100


@pytest.mark.parametrize("number", range(24))
def test_rotations_of_the_cube_give_the_bits_of_the_dense_way(number):
    a, b = make_grid(number), make_grid(number + 1, (18, 30, 22), sparse=True)
    poses = [np.eye(4), pose_of(CUBE_ROTATIONS[number], np.array([4, -3, 7]) * SIZE)]
    rule = RULES[number % 3]
    fused = vx.fuse([a, b], poses, rule=rule)
    assert_same(fused, dense_fusion.fuse([a, b], poses, rule=rule, voxel_size=SIZE))


@pytest.mark.parametrize("rule", RULES)
def test_far_frames_give_the_bits_of_the_dense_way(rule):
    a, b = make_grid(7, frame=FAR), make_grid(8, sparse=True)
    turn = turned("zyx", (0.4, 0.05, -0.1))
    poses = [np.eye(4), pose_of(turn[:3, :3], FAR + [0.5, 0.2, 0.0])]
    fused = vx.fuse([a, b], poses, rule=rule)
    assert_same(fused, dense_fusion.fuse([a, b], poses, rule=rule, voxel_size=SIZE))


@pytest.mark.parametrize("rule", RULES)
def test_windows_cut_anyhow_hold_the_blocks_of_the_whole(rule):
    grids = [make_grid(11), make_grid(12), make_grid(13)]
    poses = [np.eye(4), turned("z", 0.3, (0.4, 0.1, 0.0)), pose_of(translation=(9.0, 0.0, 0.0))]
    whole = vx.fuse(grids, poses, rule=rule)
    plan = plan_fusion(grids, poses, rule=rule, voxel_size=SIZE)
    assert plan is not None
    assert plan.shape == whole.shape
    rng = np.random.default_rng(0)
    lattice = np.asarray(whole.state_blocks().table.shape)
    cuts = [np.unique([0, n, *rng.integers(0, n, 3)]) for n in lattice]
    states, odds = BlockBuilder(plan.shape, np.uint8), BlockBuilder(plan.shape, np.float32)
    seen = np.zeros(lattice, int)
    for corner in itertools.product(*(range(len(cut) - 1) for cut in cuts)):
        low = np.array([cut[k] for cut, k in zip(cuts, corner, strict=True)])
        high = np.array([cut[k + 1] for cut, k in zip(cuts, corner, strict=True)])
        for blocks in plan.blocks_in(low, high):
            assert ((blocks.places >= low) & (blocks.places < high)).all()
            np.add.at(seen, tuple(blocks.places.T), 1)
            for builder, values in ((states, blocks.states), (odds, blocks.log_odds)):
                if values is not None:
                    (builder.put if blocks.is_level else builder.add)(blocks.places, values)
    assert seen.max() == 1
    assert states.finish().equals(whole.state_blocks())
    expected = whole.log_odds_blocks()
    assert (expected is not None) == (rule == "log_odds")
    assert expected is None or odds.finish().equals(expected)


def gathered(plan, most):
    """States and log-odds of a plan, by windows of a size."""
    states, odds = BlockBuilder(plan.shape, np.uint8), BlockBuilder(plan.shape, np.float32)
    for window in plan.windows(most):
        for blocks in plan.blocks_in(*window):
            for builder, values in ((states, blocks.states), (odds, blocks.log_odds)):
                if values is not None:
                    (builder.put if blocks.is_level else builder.add)(blocks.places, values)
    return states.finish(), odds.finish()


@pytest.mark.parametrize("rule", RULES)
def test_maps_that_stay_in_stores_give_the_bits_of_maps_in_memory(rule):
    grids = [make_grid(seed, low=(0.3, 0.0, -2.0)) for seed in (21, 22, 23)]
    grids += [make_grid(24, (90, 70, 30), with_log_odds=False)]
    # Three of them lie at one place, so that what they hold decides the order in which they are added.
    poses = [np.eye(4), np.eye(4), np.eye(4), turned("zyx", (0.5, 0.1, 0.2), (1.0, 0.3, 0.0))]
    whole = vx.fuse(grids, poses, rule=rule)
    maps = [stored(grid)[0] for grid in grids[1:]]
    plan = plan_fusion(
        [maps[1], grids[0], maps[0], maps[2]],
        [*poses[:3], poses[3]],
        rule=rule,
        voxel_size=SIZE,
        from_stores=True,
    )
    assert plan is not None
    assert plan.shape == whole.shape
    np.testing.assert_array_equal(plan.origin, whole.origin)
    for most in (1 << 18, 1 << 23):
        states, odds = gathered(plan, most)
        assert states.equals(whole.state_blocks())
        expected = whole.log_odds_blocks()
        assert expected is None or odds.equals(expected)
    for grid in maps:
        assert isinstance(grid._states, ChunkedArray)
        assert not grid._states.is_surveyed, "a map was read whole"


def test_of_a_store_a_window_reads_what_it_needs():
    states = np.ones((320, 64, 16), np.uint8)
    states[::7] = 2
    grid, reads = stored(VoxelGrid(states, np.zeros(3), SIZE), chunk=(16, 16, 16))
    plan = plan_fusion([grid], [np.eye(4)], rule="keep", voxel_size=SIZE, from_stores=True)
    assert plan is not None
    assert not reads
    blocks = list(plan.blocks_in(np.array([20, 2, 0]), np.array([22, 4, 2])))
    assert sum(len(part.places) for part in blocks) == 8
    # Blocks 19 to 22 along x, 1 to 4 along y.
    assert sorted(set(reads)) == [(x, y, 0) for x in (9, 10, 11) for y in (0, 1, 2)]


def box_of_content(rng, low, shape):
    """A sparse map of a huge box with a room in it: free, and some voxels occupied."""
    room = np.full((40, 40, 24), 1, np.uint8)
    room[rng.random(room.shape) < 0.02] = 2
    place = np.asarray(low)
    builder = BlockBuilder(shape, np.uint8)
    for index, values in blocks_of(room).parts():
        builder.add(index + place // 8, values)
    return VoxelGrid(builder.finish(), np.zeros(3), SIZE)


@pytest.mark.parametrize("rule", RULES)
def test_a_fused_box_of_more_than_2_31_voxels_costs_what_is_in_it(rule):
    """2048 x 4096 x 512 voxels: 4.3 GB as bytes."""
    rng, shape = np.random.default_rng(3), (2048, 4096, 512)
    corners = [np.array([0, 0, 0]), np.array([2048 - 40, 4096 - 40, 512 - 24])]
    grids = [box_of_content(rng, corner, shape) for corner in corners]
    moved = pose_of(translation=np.array([3, 0, -2]) * SIZE)
    vx.fuse([grids[0]] * 2, [np.eye(4), moved], rule=rule)  # kernels are compiled, and are not counted
    tracemalloc.start()
    fused = vx.fuse(grids, [np.eye(4), moved], rule=rule)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert fused.shape == (2051, 4096, 514)
    assert fused.num_voxels > 2**31
    if rule != "paper":  # boxes that overlap all but fully turn what one map sees into unknown, by that rule
        assert fused.num_occupied == sum(grid.num_occupied for grid in grids)
        assert fused.num_free == sum(grid.num_free for grid in grids)
    for grid, shift in ((grids[0], 0), (grids[1], [3, 0, -2])):
        index = grid.occupied_index() + shift + np.array([0, 0, 2])
        assert (fused.states_at(index) == 2).all()
    assert peak < 30e6, f"{peak / 1e6:.0f} MB"


def test_a_fused_box_too_long_for_float32_or_with_too_many_blocks_is_refused():
    grid = make_grid(1)
    for move in ([0.1 * (1 << 22), 0.0, 0.0], [1e5, 1e5, 1e5]):
        with pytest.raises(
            InputError, match=r"must have at most 4,194,304 voxels along an axis .* check the poses"
        ):
            vx.fuse([grid, grid], [np.eye(4), pose_of(translation=move)])
