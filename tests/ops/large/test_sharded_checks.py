"""Slips at the functions for several devices: one sentence as `InputError`, as it is without checked annotations."""

from typing import Any

import jax
import jaxtyping
import numpy as np
import pytest

from small_codes import mesh_of, small_codes
from voxjax import ops
from voxjax._checks import InputError
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.large.sharded_checks import scored_lists
from voxjax.ops.large.sharded_scoring import _padded_count

NO_MESH = jax.sharding.Mesh(np.empty(0, object), ("part",))


@pytest.fixture(autouse=True)
def _unchecked_annotations():
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="module")
def given():
    return small_codes()


@pytest.fixture(scope="module")
def codes(given):
    return ops.shard_codes(given.codes, given.block, mesh_of(2))


def refused(text, function, *args, **options):
    """That a call says the text, and is one sentence."""
    with pytest.raises(InputError) as error:
        function(*args, **options)
    said = str(error.value)
    assert said.startswith(text)
    assert said.endswith(".")


@pytest.mark.parametrize("mesh", [None, "cpu", 2, NO_MESH])
def test_what_is_no_mesh_of_devices_is_refused(given, mesh):
    text = (
        "mesh must have one device or more" if mesh is NO_MESH else f"mesh must be a Mesh, got {mesh!r}; make"
    )
    refused(text, ops.shard_blocks, given.states, mesh)
    refused(text, ops.shard_codes, given.codes, given.block, mesh)
    refused(text, ops.shard_grid, np.zeros((3, 3, 3), np.uint8), mesh)


def test_maps_that_are_not_in_blocks_are_refused(given):
    for array in (None, given.states.dense(), [[[2]]]):
        refused("array must be a BlockArray, got ", ops.shard_blocks, array, mesh_of(2))


@pytest.mark.parametrize("value", [None, "a", 1.5, float("nan"), 256, -1, True, [2]])
def test_values_that_no_voxel_can_hold_are_not_listed(given, value):
    text = f"value must be a whole number from 0 to 255, got {value!r}"
    refused(text, ops.shard_blocks, given.states, mesh_of(2), value=value)


def test_truth_values_have_one_value_to_list(given):
    occupied = blocks_of(given.states.dense() == 2)
    refused("value must be a whole number from 0 to 1, got 2", ops.shard_blocks, occupied, mesh_of(2))
    assert ops.shard_blocks(occupied, mesh_of(2), value=True).value == 1


def test_only_what_a_kernel_gave_for_the_blocks_is_gathered(codes):
    blocks = codes.blocks
    counts = ops.count_in_shards(blocks)
    for values in (np.asarray(counts), counts[1:], counts[..., 0], None):
        refused(
            f"values must be a jax.Array of shape ({len(counts)}, 8, 8, 8), got ",
            ops.gather_blocks,
            values,
            blocks,
        )


@pytest.mark.parametrize("blocks", [None, "a", np.zeros((3, 3, 3), np.uint8), [2]])
def test_what_is_no_map_in_parts_is_refused(blocks):
    text = "blocks must be a ShardedBlocks, got "
    refused(text, ops.count_in_shards, blocks)
    refused(text, ops.classes_in_shards, blocks, np.int32(20))
    refused(text, ops.gather_blocks, np.zeros((1, 8, 8, 8), np.uint8), blocks)


@pytest.mark.parametrize(
    "bound", [None, "a", 10**12, float("nan"), float("inf"), 1.5, np.float32(1.5), True, np.True_, 2j, [20]]
)
def test_bounds_that_are_no_int32_are_refused_in_parts_and_in_whole(codes, bound):
    for function, given in (
        (ops.classes_in_shards, codes.blocks),
        (ops.window_classes, np.zeros((3, 3, 3), bool)),
    ):
        refused(
            "min_change must be a whole number from -2147483648 to 2147483647, got ", function, given, bound
        )


def test_bounds_in_arrays_are_scalars_of_whole_numbers(codes):
    for bound in (np.asarray([20], np.int32), jax.numpy.zeros(2, np.int32)):
        refused(
            "min_change must be a single whole number, got int32 of shape",
            ops.classes_in_shards,
            codes.blocks,
            bound,
        )
    classify = jax.jit(lambda bound: ops.classes_in_shards(codes.blocks, bound))
    refused("min_change must be a single whole number, got float32 of shape ()", classify, np.float32(20))
    expected = np.asarray(ops.classes_in_shards(codes.blocks, np.int32(20)))
    others: list[Any] = [20, 20.0, np.int64(20), np.uint8(20), np.asarray(20), jax.numpy.int32(20)]
    for same in others:
        np.testing.assert_array_equal(np.asarray(ops.classes_in_shards(codes.blocks, same)), expected)
    np.testing.assert_array_equal(np.asarray(classify(np.int32(20))), expected)


def test_windows_are_checked_before_a_kernel_is_looked_for(codes):
    refused("size must be an odd whole number", ops.count_in_shards, codes.blocks, size=[7])
    refused("shift must be a whole number", ops.classes_in_shards, codes.blocks, np.int32(20), shift=[4])


def test_codes_belong_to_the_rows_of_their_block(given):
    flat = np.asarray(given.codes)
    for some in (None, flat[:700], flat.reshape(-1, 512), flat.astype(np.float32), "a", [[1], [1, 2]]):
        refused("codes must be a flat array of ", ops.shard_codes, some, given.block, mesh_of(2))
    # Both may be longer than the box, by any number.
    longer = given.block._replace(table=np.append(np.asarray(given.block.table), np.zeros(3, np.int32)))
    ops.shard_codes(np.append(flat, np.zeros(5, np.uint8)), longer, mesh_of(2))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"dims": np.asarray([61, 37], np.int32)}, "block.dims must be three whole numbers"),
        ({"dims": np.asarray([61, 37, 0], np.int32)}, "block.dims must be three whole numbers"),
        ({"dims": [[1], [1, 2]]}, "block.dims must be three whole numbers"),
        ({"origin": "a"}, "block.origin must be an array of real numbers"),
        ({"origin": np.zeros(2, np.float32)}, "block.origin must be three numbers"),
        ({"voxel_size": 0.0}, "block.voxel_size must be a finite number above 0"),
        ({"table": np.zeros(3, np.int32)}, "block.table must be a flat array of 280 rows or more"),
        ({"table": np.full(280, -1, np.int32)}, "block.table must hold rows from 0 on"),
    ],
)
def test_places_of_codes_are_refused_by_name(given, change, text):
    refused(text, ops.shard_codes, given.codes, given.block._replace(**change), mesh_of(2))


def test_tuples_are_no_blocks(given):
    refused("block must be a Block, got (", ops.shard_codes, given.codes, tuple(given.block), mesh_of(2))


@pytest.mark.parametrize("batch_size", [0, -1, 1.5, None, True, "a"])
def test_batches_without_poses_are_refused(given, codes, batch_size):
    lists = given.points, given.whole_weights, given.poses
    text = f"batch_size must be a whole number, 1 or more, got {batch_size!r}"
    refused(text, ops.score_in_shards, codes, *lists, batch_size=batch_size)


def test_lists_that_do_not_fit_each_other_are_refused(given, codes):
    points, weights, poses = given.points, given.whole_weights, given.poses
    for lists, text in (
        ((points[:5], weights[:3], poses), "weights must be as many as points, got 3 for 5"),
        ((points[0], weights, poses), "points must be an array of shape (n, 3), got shape (3,)"),
        ((points[:, :2], weights, poses), "points must be an array of shape (n, 3)"),
        ((None, weights, poses), "points must be an array of real numbers, got None"),
        ((points, weights[:, None], poses), "weights must be an array of shape (n,), got shape (9000, 1)"),
        ((points, 1.0, poses), "weights must be an array of shape (n,), got shape ()"),
        ((points, weights, poses[0]), "poses must be an array of shape (n, 4, 4), got shape (4, 4)"),
        ((points, weights, "a"), "poses must be an array of real numbers, got 'a'"),
        ((points, weights, [poses[0], poses[0][:3]]), "poses must be an array of real numbers"),
        ((points, weights, poses * 1j), "poses must be an array of real numbers"),
    ):
        refused(text, ops.score_in_shards, codes, *lists)
        if all(isinstance(some, np.ndarray) and some.dtype == np.float32 for some in lists):
            refused(text, jax.jit(lambda *some: ops.score_in_shards(codes, *some)), *lists)
    refused("codes must be a ShardedCodes, got ", ops.score_in_shards, given.codes, points, weights, poses)


def test_points_that_are_nowhere_are_refused_unless_they_have_no_weight(given, codes):
    points, weights = given.points.copy(), given.whole_weights.copy()
    points[7], weights[7] = np.nan, 1.0
    text = "points must be finite, but 1 of "
    refused(text, ops.score_in_shards, codes, points, weights, given.poses)
    weights[7] = 0.0
    scores = np.asarray(ops.score_in_shards(codes, points, weights, given.poses))
    np.testing.assert_array_equal(scores, given.scores(weights))
    refused("weights must be finite", ops.score_in_shards, codes, given.points, weights + np.inf, given.poses)
    poses = given.poses.astype(np.float64)
    poses[3, 0, 3] = 1e300
    refused("poses must be finite, but 1 of 20", ops.score_in_shards, codes, given.points, weights, poses)


def test_no_poses_have_no_scores_and_lists_serve_as_arrays(given, codes):
    points, weights = given.points[:5], given.whole_weights[:5]
    none: list[Any] = [[], given.poses[:0]]
    for poses in none:
        scores = ops.score_in_shards(codes, points, weights, poses)
        assert (scores.shape, scores.dtype) == ((0, 3), np.float32)
    expected = np.asarray(ops.score_in_shards(codes, points, weights, given.poses))
    found = ops.score_in_shards(codes, points.tolist(), weights.astype(int), given.poses.tolist())
    np.testing.assert_array_equal(np.asarray(found), expected)
    nothing = ops.score_in_shards(codes, points[:0], weights[:0], given.poses)
    assert nothing.shape == (20, 3)
    assert not np.asarray(nothing).any()
    assert [some.shape for some in scored_lists([], [], [])] == [(0, 3), (0,), (0, 4, 4)]


def test_batches_longer_than_the_poses_are_cut(given, codes):
    lists = given.points, given.whole_weights, given.poses
    scores = ops.score_in_shards(codes, *lists, batch_size=10**12)
    np.testing.assert_array_equal(np.asarray(scores), given.scores(given.whole_weights))


@pytest.mark.parametrize("batch_size", [1, 3, 5, 8, 12])
def test_batches_divide_the_poses_that_are_padded(batch_size):
    for count in range(1, 60):
        assert _padded_count(count, batch_size, 1) >= count
        together = _padded_count(count, batch_size, batch_size)
        assert together >= count
        assert together % batch_size == 0
