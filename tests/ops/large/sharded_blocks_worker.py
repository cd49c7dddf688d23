"""A process of its own for the tests of maps in parts: `FILE devices`, or `FILE process PORT COUNT RANK`.

Compares with what one device gave, which lies in the file, and prints one line for each mesh that is right.
"""

import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
MIN_CHANGE = np.int32(20)


def check(path, devices, mesh_shape):
    """Counts, classes and scores over a mesh are those of one device, and each process builds its own parts alone."""
    import small_codes
    from voxjax.ops.large import sharded_blocks
    from voxjax.ops.large.sharded_scoring import score_in_shards, shard_codes
    from voxjax.ops.large.sharded_windows import classes_in_shards, count_in_shards

    built = []
    build = sharded_blocks.pool_of
    sharded_blocks.pool_of = lambda part, *others: (built.append(part), build(part, *others))
    mesh = jax.sharding.Mesh(np.asarray(devices).reshape(mesh_shape), ("a", "b")[: len(mesh_shape)])
    given, expected = small_codes.small_codes(), np.load(path)
    blocks = sharded_blocks.shard_blocks(given.states, mesh)
    assert len(built) == len([device for device in devices if device.process_index == jax.process_index()])
    assert len(blocks.pool.sharding.device_set) == len(devices)
    sharded_blocks.pool_of = build
    for name, found in (
        ("classes", classes_in_shards(blocks, MIN_CHANGE)),
        ("counts", count_in_shards(blocks)),
    ):
        at_voxels = sharded_blocks.gather_blocks(found, blocks).take(given.index)
        np.testing.assert_array_equal(at_voxels, expected[name])
    codes = shard_codes(given.codes, given.block, mesh)
    scores = score_in_shards(codes, given.points, given.whole_weights, given.poses)
    np.testing.assert_array_equal(np.asarray(scores), expected["scores"])
    print(f"equal on {mesh_shape}", flush=True)


def main(argv):
    path, kind, *numbers = argv
    if kind == "devices":
        for mesh_shape in ((8,), (2, 4)):
            check(path, jax.devices(), mesh_shape)
        return
    port, count, rank = map(int, numbers)
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(f"127.0.0.1:{port}", count, rank)
    assert jax.process_count() == count
    check(path, jax.devices(), (len(jax.devices()),))


if __name__ == "__main__":
    main(sys.argv[1:])
