"""Rows of the sharded path: one grid over several devices against one device.

Where the process has one device only, as on most CPUs, the row runs in a process of its own with as many host devices
as there are cores: they share the cores with each other, so this shows what the exchange of halos costs, not what more
devices would bring. Its times hold a round trip through a pipe, some 0.1 ms.
"""

import functools
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import jax
import numpy as np

from bench.kernel_row import KernelRow
from voxjax.ops.large.sharded import gather_shards, map_shards, shard_grid
from voxjax.ops.window.classes import box_count

_COUNT = functools.partial(box_count, size=7)
_READY = "ready"
_SHARDS, _SINGLE = "shards", "one device"


def rows(*, quick: bool) -> Iterator[KernelRow]:
    """Rows of this module."""
    side = 128 if quick else 256
    if len(jax.devices()) > 1:
        yield _row(side, len(jax.devices()), _calls(side), f"{jax.devices()[0].device_kind}, in this process")
        return
    cores = max(len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1, 2)
    with _worker(side, cores) as ask:
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


@contextmanager
def _worker(side: int, devices: int) -> Iterator[Callable[[str], str]]:
    """A process with so many host devices; calling what this gives runs a candidate in it and waits for the end."""
    # The number of host devices is fixed when JAX starts, so it takes a process of its own.
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    with subprocess.Popen(
        [sys.executable, "-m", "bench.kernel_rows.sharded", str(side)],
        env=os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        send, receive = process.stdin, process.stdout

        def answer() -> str:
            line = receive.readline().strip()
            if line != _READY:
                raise RuntimeError(f"the process with {devices} devices failed; its messages stand above")
            return line

        def ask(name: str) -> str:
            send.write(name + "\n")
            send.flush()
            return answer()

        answer()
        try:
            yield ask
        finally:
            process.kill()


def _serve(side: int) -> None:
    """Answer each line that names a candidate once it has run."""
    calls = _calls(side)
    print(_READY, flush=True)
    for line in sys.stdin:
        jax.block_until_ready(calls[line.strip()]())
        print(_READY, flush=True)


if __name__ == "__main__":
    _serve(int(sys.argv[1]))
