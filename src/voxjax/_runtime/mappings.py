"""Room for compiled kernels: a process that registers many maps must not run out of memory mappings.

Each kernel compiled for the CPU holds some tens of memory mappings, and Linux grants a process 65,530 of them by
default; beyond, the compiler aborts the process. Maps of ever new sizes would get there after some thirty pairs.
"""

from pathlib import Path

import jax


def mappings_in_use() -> tuple[int, int] | None:
    """Memory mappings of this process and how many it may have; None where the system does not say."""
    try:
        with Path("/proc/self/maps").open("rb") as lines:
            return sum(1 for _ in lines), int(Path("/proc/sys/vm/max_map_count").read_text())
    except (OSError, ValueError):
        return None


def release_kernels_if_crowded(*, max_share: float = 0.6) -> bool:
    """Drop all compiled kernels of the process when its mappings run out; what is needed again is compiled again.

    Returns:
        Whether kernels were dropped.
    """
    mappings = mappings_in_use()
    # This is asked between pairs: the rest has to hold what the next pair compiles.
    if mappings is None or mappings[0] < max_share * mappings[1]:
        return False
    # Mappings belong to kernels: they go once nobody can call a kernel any more.
    jax.clear_caches()
    return True
