"""Maps in blocks over several devices: nothing is lost, and one, two and eight devices and two processes agree."""

from pathlib import Path

import jax
import numpy as np
import pytest

from host_devices import lines_of, start, start_joined
from small_codes import mesh_of, small_codes
from voxjax._checks import InputError
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.large.sharded_blocks import gather_blocks, shard_blocks
from voxjax.ops.large.sharded_windows import count_in_shards

WORKER = Path(__file__).parent / "sharded_blocks_worker.py"
OCCUPIED = 2


def _states(shape=(70, 20, 33), share=0.01, seed=0):
    rng = np.random.default_rng(seed)
    return rng.choice(np.asarray([0, 1, OCCUPIED], np.uint8), shape, p=[0.5, 0.5 - share, share])


def _held(array, mesh, **options):
    """Whether each voxel holds the value, by way of the devices: the count of a window of one voxel."""
    blocks = shard_blocks(array, mesh, **options)
    return gather_blocks(count_in_shards(blocks, size=1), blocks)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """A file of what one device gives for the small map at its occupied voxels."""
    path, given = tmp_path_factory.mktemp("expected") / "one_device.npz", small_codes()
    classes = given.classes(np.int32(20))[tuple(given.index.T)]
    np.savez(path, classes=classes, counts=given.counts(), scores=given.scores(given.whole_weights))
    return path


def test_kernels_over_eight_devices_equal_those_of_one(expected):
    (lines,) = lines_of([start(WORKER, [expected, "devices"], devices=8)])
    assert lines == ["equal on (8,)", "equal on (2, 4)"]


def test_kernels_over_two_processes_equal_those_of_one(expected):
    lines = lines_of(start_joined(WORKER, [expected], processes=2, devices=2))
    assert lines == [["equal on (4,)"]] * 2


@pytest.mark.parametrize("devices", [1, 2])
@pytest.mark.parametrize("shape", [(1, 1, 1), (9, 40, 5), (70, 20, 33)])
def test_listed_blocks_come_back_as_they_were(shape, devices):
    states = _states(shape)
    held = _held(blocks_of(states), mesh_of(devices))
    assert held.shape == shape
    np.testing.assert_array_equal(held.dense(), states == OCCUPIED)


def test_parts_hold_as_many_blocks_whatever_they_span():
    states = _states((160, 20, 33), 0.0)
    # All but a few occupied voxels lie in a tenth of the box.
    states[:16] = OCCUPIED
    states[100:110, 3, 3] = OCCUPIED
    blocks = shard_blocks(blocks_of(states), mesh_of(2))
    counts = (np.asarray(blocks.places).reshape(2, -1, 3)[..., 0] >= 0).sum(axis=1)
    assert abs(int(counts[0]) - int(counts[1])) <= 1


def test_a_map_of_one_block_and_one_of_none_leave_parts_empty():
    states = np.zeros((20, 20, 20), np.uint8)
    assert _held(blocks_of(states), mesh_of(2)).count(1) == 0
    states[17, 3, 9] = OCCUPIED
    held = _held(blocks_of(states), mesh_of(2))
    np.testing.assert_array_equal(held.where(1), [[17, 3, 9]])


def test_other_values_and_truth_values_can_be_listed():
    states = _states()
    np.testing.assert_array_equal(_held(blocks_of(states), mesh_of(2), value=1).dense(), states == 1)
    occupied = states == OCCUPIED
    np.testing.assert_array_equal(_held(blocks_of(occupied), mesh_of(2), value=1).dense(), occupied)


def test_maps_of_about_one_size_have_parts_of_one_shape():
    one, other = (shard_blocks(blocks_of(_states((70, 20, n))), mesh_of(2)) for n in (30, 33))
    assert jax.tree.map(np.shape, (one.pool, one.table, one.places)) == jax.tree.map(
        np.shape, (other.pool, other.table, other.places)
    )


def test_what_cannot_be_cut_is_refused(monkeypatch):
    with pytest.raises(InputError, match="value must not be 0"):
        shard_blocks(blocks_of(_states()), mesh_of(2), value=0)
    with pytest.raises(InputError, match="whole numbers or truth values, got float32"):
        shard_blocks(blocks_of(_states().astype(np.float32)), mesh_of(2))
    with pytest.raises(InputError, match=r"of shape \(0, 3, 3\)"):
        shard_blocks(blocks_of(np.zeros((0, 3, 3), np.uint8)), mesh_of(2))
    monkeypatch.setenv("VOXJAX_MEMORY", "0.0001")
    with pytest.raises(InputError, match="2 of 2 parts of a map in blocks needs about"):
        shard_blocks(blocks_of(_states()), mesh_of(2))
