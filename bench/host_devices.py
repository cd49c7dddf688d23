"""Candidates of a benchmark in a process of its own with several host devices.

The number of host devices is fixed when JAX starts. They share the cores with each other, so times with them show what
sharing out costs, not what more devices would bring. Times hold a round trip through a pipe, some 0.1 ms.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import jax

_READY = "ready"


def num_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def candidates_of(
    module: str, arguments: list[str], *, devices: int, flags: str = ""
) -> Iterator[tuple[Callable[[str], str], str]]:
    """A process with so many host devices, which runs a module that calls `serve`.

    Args:
        module: Name of the module.
        arguments: What it is called with.
        devices: Number of host devices.
        flags: More flags of XLA.

    Yields:
        A function that runs the candidate of a name there and waits for its end, and what the module says of itself.
    """
    known = f"{os.environ.get('XLA_FLAGS', '')} {flags}".strip()
    with subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        env=os.environ | {"JAX_NUM_CPU_DEVICES": str(devices), "XLA_FLAGS": known, "JAX_PLATFORMS": "cpu"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        send, receive = process.stdin, process.stdout

        def answer() -> str:
            word, _, said = receive.readline().strip().partition(" ")
            if word != _READY:
                raise RuntimeError(f"the process with {devices} devices failed; its messages stand above")
            return said

        def ask(name: str) -> str:
            send.write(name + "\n")
            send.flush()
            return answer()

        said = answer()
        try:
            yield ask, said
        finally:
            process.kill()


def serve(candidates: Mapping[str, Callable[[], object]], said: str = "") -> None:
    """Answer each line that names a candidate once it has run.

    Args:
        candidates: Functions of no arguments by name.
        said: One line about them.
    """
    print(_READY, said, flush=True)
    for line in sys.stdin:
        jax.block_until_ready(candidates[line.strip()]())
        print(_READY, flush=True)
