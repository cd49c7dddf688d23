"""A process that was forked after kernels ran can run none: it has no copy of JAX's threads, and waits for them.

What hangs cannot explain itself, so the first kernel in such a process raises one sentence instead.
"""

import os

_has_run = False
_is_stranded = False


def refuse_after_fork() -> None:
    """Remember that this process runs kernels; raise if the process that it was forked from had.

    Raises:
        RuntimeError: In a forked process whose parent had run kernels of voxjax.
    """
    global _has_run
    if _is_stranded:
        raise RuntimeError(
            "voxjax cannot run in a process that was forked after voxjax had run, because JAX would wait forever for "
            "threads that a fork does not copy; start processes with multiprocessing.get_context('spawn')."
        )
    _has_run = True


def _after_fork() -> None:
    """Note a fork in the child; nothing is raised here, because a child may only start another program."""
    global _is_stranded
    _is_stranded = _is_stranded or _has_run


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
