"""Scores against a map in parts are those of one device: whole weights to the bit, others to what sums round."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from small_codes import mesh_of, small_codes
from voxjax._checks import InputError
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.large import sharded_scoring
from voxjax.ops.large.sharded_scoring import score_in_shards, shard_codes


@pytest.mark.parametrize("devices", [1, 2])
def test_scores_of_whole_weights_are_the_same_bits(devices):
    given = small_codes()
    codes = shard_codes(given.codes, given.block, mesh_of(devices))
    scores = score_in_shards(codes, given.points, given.whole_weights, given.poses)
    expected = given.scores(given.whole_weights)
    np.testing.assert_array_equal(np.asarray(scores), expected)
    assert scores.dtype == np.float32
    assert (expected > 0).any(axis=0).all()


def test_scores_of_any_weights_differ_by_the_rounding_of_sums():
    given = small_codes()
    codes = shard_codes(given.codes, given.block, mesh_of(2))
    scores = score_in_shards(codes, given.points, given.weights, given.poses)
    # Sums of 9000 numbers below 1, in another order.
    np.testing.assert_allclose(np.asarray(scores), given.scores(given.weights), rtol=1e-5, atol=1e-3)


def test_poses_that_are_handled_together_meet_what_each_of_them_meets():
    given = small_codes()
    codes = shard_codes(given.codes, given.block, mesh_of(2))
    points, weights = sharded_scoring._in_pieces(given.points, given.whole_weights, 4096)
    columns, shares = points.reshape(-1, 4096, 3).swapaxes(1, 2), weights.reshape(-1, 4096)
    scores = sharded_scoring._scores(codes, columns, shares, given.poses, together=4)
    np.testing.assert_array_equal(np.asarray(scores), given.scores(given.whole_weights))


def test_lists_of_any_length_and_traced_ones_are_scored_alike():
    given = small_codes()
    codes = shard_codes(given.codes, given.block, mesh_of(2))
    whole = np.asarray(score_in_shards(codes, given.points, given.whole_weights, given.poses))
    some = score_in_shards(codes, given.points, given.whole_weights, given.poses[:3])
    np.testing.assert_array_equal(np.asarray(some), whole[:3])
    score = jax.jit(lambda poses: score_in_shards(codes, given.points, given.whole_weights, poses))
    np.testing.assert_array_equal(np.asarray(score(given.poses)), whole)
    nothing = score_in_shards(codes, given.points[:0], given.whole_weights[:0], given.poses)
    assert not np.asarray(nothing).any()
    assert score_in_shards(codes, given.points, given.whole_weights, given.poses[:0]).shape == (0, 3)


def test_a_map_that_knows_nothing_meets_nothing():
    dims = np.asarray([20, 20, 20], np.int32)
    block = Block(dims, np.zeros(3, np.float32), np.float32(0.1), np.zeros(27, np.int32))
    codes = shard_codes(np.zeros(512, np.uint8), block, mesh_of(2))
    given = small_codes()
    scores = score_in_shards(codes, given.points, given.whole_weights, given.poses)
    assert not np.asarray(scores).any()


def test_pieces_are_left_out_where_none_of_their_points_reaches_the_layers_of_a_part():
    given = small_codes()
    codes = shard_codes(given.codes, given.block, mesh_of(2))
    points, weights = sharded_scoring._in_pieces(given.points, given.whole_weights, 256)
    columns, shares = points.reshape(-1, 256, 3).swapaxes(1, 2), weights.reshape(-1, 256)
    boxes = sharded_scoring._boxes_of(jnp.asarray(columns), jnp.asarray(shares))
    left_out = 0
    for span in np.asarray(codes.blocks.span):
        part = eqx.tree_at(lambda b: b.span, codes.blocks, span[None])
        own = sharded_scoring._OwnBlock(*given.block[:3], part)
        layers = span[1:] // (codes.blocks.lattice[1] * codes.blocks.lattice[2])
        for T in given.poses:
            is_met = np.asarray(own.meets(jnp.asarray(T), *boxes))
            x = np.einsum("j,mjs->ms", T[0, :3], columns) + T[0, 3] - given.block.origin[0]
            layer = np.floor(x / 0.1 / 8)
            reaches = (layer >= layers[0]) & (layer <= layers[1]) & (shares != 0)
            assert not reaches[~is_met].any()
            left_out += np.count_nonzero(~is_met)
    # Of two parts most pieces reach one alone, or neither.
    assert left_out > 0.3 * 2 * len(given.poses) * len(columns)


def test_dense_fields_are_refused():
    given = small_codes()
    with pytest.raises(InputError, match="block must have a table"):
        shard_codes(given.codes, given.block._replace(table=None), mesh_of())
