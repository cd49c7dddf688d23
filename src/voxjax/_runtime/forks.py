"""A process that was forked after JAX began can run no kernel: it has no copy of JAX's threads, and waits for them.

What hangs cannot explain itself, so whatever would run kernels in such a process raises one sentence instead.
"""

import functools
import os
import sys
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

_is_stranded = False


def refuse_after_fork() -> None:
    """Raise if the process that this one was forked from had begun to use JAX, whoever asked it to.

    Raises:
        RuntimeError: In such a process.
    """
    if _is_stranded:
        raise RuntimeError(
            "voxjax cannot run in a process that was forked after JAX had begun, because JAX would wait forever for "
            "threads that a fork does not copy; start processes with multiprocessing.get_context('spawn')."
        )


def refused_after_fork(function: F) -> F:
    """A function that runs kernels, which says so in a forked process instead of hanging.

    It stands outside `jax.jit`: a jitted function whose kernel is compiled runs none of its own lines.
    """

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        refuse_after_fork()
        return function(*args, **kwargs)

    # A jitted function can also be asked for its program, as the benchmarks do.
    if hasattr(function, "lower"):
        call.lower = function.lower  # pyright: ignore[reportAttributeAccessIssue]
    return cast(F, call)


def _after_fork() -> None:
    """Note a fork in the child; nothing is raised here, because a child may only start another program."""
    global _is_stranded
    # JAX starts its threads with its backends. Its public functions would start them too, and those that only look
    # take a lock, which a thread may hold that the fork has not copied.
    bridge = sys.modules.get("jax._src.xla_bridge")
    # What a stranded process lacks, the processes that are forked from it lack as well.
    _is_stranded = _is_stranded or bool(getattr(bridge, "_backends", None))


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
