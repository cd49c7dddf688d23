"""Rows of the sharded path: one grid over several devices against one device.

Where the process has one device only, as on most CPUs, the row runs in a process of its own with as many host devices
as there are cores (`bench.host_devices`).
"""

import functools
import sys
from collections.abc import Callable, Iterator, Mapping

import jax
import numpy as np

from bench.host_devices import candidates_of, num_cores, serve
from bench.kernel_row import KernelRow
from voxjax.ops.large.sharded import gather_shards, map_shards, shard_grid
from voxjax.ops.window.classes import box_count

_COUNT = functools.partial(box_count, size=7)
_SHARDS, _SINGLE = "shards", "one device"


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module."""
    side = 128 if quick else 256
    if len(jax.devices()) > 1:
        yield _row(side, len(jax.devices()), _calls(side), f"{jax.devices()[0].device_kind}, in this process")
        return
    cores = max(num_cores(), 2)
    with candidates_of("bench.kernel_rows.sharded", [str(side)], devices=cores) as (ask, _):
        calls = {name: functools.partial(ask, name) for name in (_SHARDS, _SINGLE)}
        yield _row(
            side, cores, calls, "host devices that share the cores, in a process of its own, by a pipe"
        )


def _row(side: int, devices: int, calls: Mapping[str, Callable[[], object]], note: str) -> KernelRow:
    """The row, results compared by `_calls`."""
    return KernelRow(
        name=f"box_count 7 over {devices} devices, {side}^3",
        ours=_SHARDS,
        candidates=calls,
        count=side**3,
        unit="voxel",
        bytes_moved=3.0 * side**3,
        note=note,
    )


def _calls(side: int) -> dict[str, Callable[[], object]]:
    """Both candidates on the devices of this process, after comparing their results."""
    host = np.random.default_rng(0).random((side,) * 3, np.float32) < 0.03
    mesh = jax.sharding.Mesh(np.asarray(jax.devices()), ("x",))
    grid, whole = shard_grid(host, mesh, max_halo=3), jax.device_put(host, jax.devices()[0])

    def shards() -> object:
        return map_shards(_COUNT, grid, halo=3).values

    np.testing.assert_array_equal(gather_shards(map_shards(_COUNT, grid, halo=3)), np.asarray(_COUNT(whole)))
    return {_SHARDS: shards, _SINGLE: lambda: _COUNT(whole)}


if __name__ == "__main__":
    serve(_calls(int(sys.argv[1])))
