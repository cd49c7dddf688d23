"""Rows of maps in parts: windows and scores on one and on two host devices, of one map, and of a map twice as long.

Each host device has one thread, so that two take two cores as two machines would, as long as there are as many; two
devices are not twice as fast where they wait for memory or for other work. The note of a row has seconds of CPU, which
show what the parts cost beside their own work whatever else runs.
"""

import functools
import sys
import time
from collections.abc import Callable, Iterator, Mapping

import jax
import numpy as np

from bench.host_devices import candidates_of, num_cores, serve
from bench.kernel_row import KernelRow
from bench.kernel_rows.scene import rooms
from bench.kernel_rows.scoring import poses_around
from voxjax._types import OCCUPIED
from voxjax.ops.blocks.block_array import BlockArray
from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.ops.evidence.lookup import Block
from voxjax.ops.evidence.map_tables import code_pool, map_pools
from voxjax.ops.evidence.scoring import score_poses
from voxjax.ops.large.sharded_blocks import gather_blocks, shard_blocks
from voxjax.ops.large.sharded_scoring import score_in_shards, shard_codes
from voxjax.ops.large.sharded_windows import classes_in_shards
from voxjax.ops.window.classes import window_classes

_ONE, _TWO, _TWICE, _WHOLE = "1 device", "2 devices", "2 devices, twice the map", "dense"
_MIN_CHANGE = np.int32(20)
_ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module."""
    side = 64 if quick else 192
    for kind, unit in (("classes", "block"), ("scores", "lookup")):
        with candidates_of(
            "bench.kernel_rows.sharded_blocks", [kind, str(side)], devices=2, flags=_ONE_THREAD
        ) as (ask, said):
            count, _, note = said.partition(" ")
            names = (_TWO, _ONE, _TWICE, *((_WHOLE,) if kind == "classes" else ()))
            yield KernelRow(
                name=f"{kind} of a map in parts, {side}^3",
                ours=_TWO,
                candidates={name: functools.partial(ask, name) for name in names},
                count=int(count),
                unit=unit,
                note=f"{note}; {num_cores()} cores, a thread a device",
            )


def _maps(side: int) -> tuple[BlockArray, BlockArray]:
    """A map of rooms, and one of two such along x."""
    states = rooms(side)
    return blocks_of(states), blocks_of(np.concatenate([states, states]))


def _meshes() -> tuple[jax.sharding.Mesh, jax.sharding.Mesh]:
    """Meshes of one and of two devices."""
    one, two = (jax.sharding.Mesh(np.asarray(jax.devices()[:count]), ("part",)) for count in (1, 2))
    return one, two


def _classes(side: int) -> tuple[dict[str, Callable[[], object]], int]:
    """Candidates for classes, and the number of blocks of one map; compared with those of the dense grid before."""
    (small, large), (one, two) = _maps(side), _meshes()
    cut = {_ONE: shard_blocks(small, one), _TWO: shard_blocks(small, two), _TWICE: shard_blocks(large, two)}
    whole = jax.device_put(small.dense() == OCCUPIED, jax.devices()[0])
    expected = np.asarray(window_classes(whole, _MIN_CHANGE, implementation="passes"))
    for name in (_ONE, _TWO):
        found = gather_blocks(classes_in_shards(cut[name], _MIN_CHANGE), cut[name])
        np.testing.assert_array_equal(found.dense(), expected)
    calls: dict[str, Callable[[], object]] = {
        name: functools.partial(classes_in_shards, blocks, _MIN_CHANGE) for name, blocks in cut.items()
    }
    calls[_WHOLE] = functools.partial(window_classes, whole, _MIN_CHANGE, implementation="passes")
    return calls, int((np.asarray(cut[_ONE].places)[:, 0] >= 0).sum())


def _scores(side: int) -> tuple[dict[str, Callable[[], object]], int]:
    """Candidates for scores of 64 poses of the map's own voxels, and the lookups in one map; compared before."""
    (small, large), (one, two) = _maps(side), _meshes()
    calls, count, poses = {}, 0, poses_around(64)
    for states, meshes in ((small, {_ONE: one, _TWO: two}), (large, {_TWICE: two})):
        index = states.where(OCCUPIED)
        pools = map_pools(states, index, radius=5)
        codes = code_pool(pools.states, pools.keys, pools.num_rows, hit_sq=2, clear_sq=4)
        place = np.asarray(states.shape, np.int32), np.zeros(3, np.float32), np.float32(0.1), pools.table
        lists = ((index + 0.5) * 0.1).astype(np.float32), np.ones(len(index), np.float32), poses
        expected = np.asarray(score_poses(codes, Block(*place), *lists))
        count = count or len(index) * len(poses)
        for name, mesh in meshes.items():
            calls[name] = functools.partial(score_in_shards, shard_codes(codes, Block(*place), mesh), *lists)
            np.testing.assert_array_equal(np.asarray(calls[name]()), expected)
    return calls, count


def _cpu_seconds(calls: Mapping[str, Callable[[], object]], *, rounds: int = 3) -> str:
    """Seconds of CPU of each candidate, the least of some calls."""
    best = dict.fromkeys(calls, np.inf)
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.process_time()
            jax.block_until_ready(call())
            best[name] = min(best[name], time.process_time() - start)
    return ", ".join(f"{name} {1e3 * seconds:.0f} ms" for name, seconds in best.items())


if __name__ == "__main__":
    candidates, number = {"classes": _classes, "scores": _scores}[sys.argv[1]](int(sys.argv[2]))
    serve(candidates, f"{number} CPU: {_cpu_seconds(candidates)}")
