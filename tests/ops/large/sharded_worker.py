"""A process of its own for the tests of sharding: `devices N`, or `process PORT COUNT RANK`.

Compares with the counts of the definition and prints one line for each mesh that is right.
"""

import functools
import sys
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))
SHAPE = (37, 22, 19)


def check(devices, mesh_shape):
    """Counts and counts of counts over a mesh, equal to the definition bit for bit."""
    from oracles import sliding_window
    from voxjax.ops.large.sharded import gather_shards, map_shards, shard_grid
    from voxjax.ops.window.classes import box_count

    occupied = np.random.default_rng(7).random(SHAPE) < 0.2
    mesh = jax.sharding.Mesh(np.asarray(devices).reshape(mesh_shape), ("x", "y", "z")[: len(mesh_shape)])
    grid = shard_grid(occupied, mesh)
    assert len(grid.values.sharding.device_set) == len(devices)
    expected = sliding_window.window_count(occupied, 7)
    counts = map_shards(functools.partial(box_count, size=7), grid, halo=3)
    for shard in counts.values.addressable_shards:
        low = [part.start or 0 for part in shard.index]
        own = expected[tuple(slice(n, n + m) for n, m in zip(low, shard.data.shape, strict=True))]
        inside = tuple(slice(n) for n in own.shape)
        np.testing.assert_array_equal(np.asarray(shard.data)[inside], own)
        assert np.asarray(shard.data).sum() == own.sum()
    np.testing.assert_array_equal(gather_shards(counts), expected)
    many = map_shards(lambda c: box_count(c > 30, size=5), counts, halo=2)
    np.testing.assert_array_equal(gather_shards(many), sliding_window.window_count(expected > 30, 5))
    print(f"equal on {len(devices)} devices as {mesh_shape}", flush=True)


def main(argv):
    if argv[0] == "devices":
        for mesh_shape in ((2,), (4,), (8,), (4, 2), (2, 2, 2)):
            check(jax.devices()[: int(np.prod(mesh_shape))], mesh_shape)
        return
    port, count, rank = map(int, argv[1:])
    jax.config.update("jax_cpu_collectives_implementation", "gloo")
    jax.distributed.initialize(f"127.0.0.1:{port}", count, rank)
    assert jax.process_count() == count
    devices = jax.devices()
    check(devices, (len(devices),))
    check(devices, (count, len(devices) // count))


if __name__ == "__main__":
    main(sys.argv[1:])
