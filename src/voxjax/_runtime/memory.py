"""How much memory there is, and a refusal before the work where it will not do: a killed process explains nothing."""

import math
import os
from collections.abc import Iterator
from pathlib import Path

from .._checks import InputError
from .memory_sizes import gigabytes_of

GIGABYTE = 1e9


def available_memory(root: Path = Path("/")) -> int | None:
    """Memory that this process may still take [byte]; None where the system does not say.

    On Linux the least of what the machine has left, free swap included, and what each control group (container) leaves
    of its limit; elsewhere the machine's free memory, or all of it where that is all that is known.

    Args:
        root: Where the system's own files are found.
    """
    machine = _machine_memory(root)
    # A container may be granted more than the machine has left, and the machine more than the container.
    bounds = [*_group_memory(root), *([] if machine is None else [machine])]
    return max(min(bounds), 0) if bounds else None


def check_memory(need: float, what: str, advice: str, *, on_device: bool = True) -> None:
    """Raise if something needs more memory than there is.

    The environment variable `VOXJAX_MEMORY` overrides what there is: a size such as 2G or 500M, or "off" for no check.

    Args:
        need: Memory that it takes beside what is taken already [byte].
        what: What needs it, the subject of the sentence.
        advice: What to do instead.
        on_device: Whether the work runs on the default device, whose memory then bounds it too.

    Raises:
        InputError: If there is less, or `VOXJAX_MEMORY` is neither.
    """
    limit = memory_limit(on_device=on_device)
    if limit is not None and need > limit:
        raise InputError(
            f"{what} needs about {need / GIGABYTE:.3g} GB of memory and {limit / GIGABYTE:.3g} GB are available; "
            f"{advice}; VOXJAX_MEMORY=off skips this check."
        )


def memory_limit(*, on_device: bool = True) -> float | None:
    """Memory that work may take [byte]: what `VOXJAX_MEMORY` says, else what host and device have; None for no limit.

    Args:
        on_device: Whether the work needs the device's memory as well as the host's.

    Raises:
        InputError: If `VOXJAX_MEMORY` is no size and not "off".
    """
    chosen = chosen_memory()
    if chosen is not None:
        return None if math.isinf(chosen) else chosen
    # Results come back to the host, so that its memory bounds work on an accelerator too.
    known = (available_memory(), device_memory() if on_device else None)
    bounds = [bound for bound in known if bound is not None]
    return float(min(bounds)) if bounds else None


def chosen_memory() -> float | None:
    """Memory that `VOXJAX_MEMORY` allows [byte], infinite if it is "off"; None if it is not set.

    Raises:
        InputError: If it is no size and not "off".
    """
    setting = os.environ.get("VOXJAX_MEMORY", "")
    if not setting:
        return None
    return math.inf if setting == "off" else _gigabytes(setting) * GIGABYTE


def device_memory() -> int | None:
    """Memory left on the first accelerator [byte]; None on a CPU and where the device does not say."""
    import jax

    device = jax.local_devices()[0]
    stats = None if device.platform == "cpu" else device.memory_stats()
    if not stats or "bytes_limit" not in stats:
        return None
    return stats["bytes_limit"] - stats.get("bytes_in_use", 0)


def _gigabytes(setting: str) -> float:
    number = gigabytes_of(setting)
    if number is None:
        raise InputError(
            "VOXJAX_MEMORY must be a size such as 2G or 500M (a number alone counts gigabytes), or off, got "
            f"{setting!r}."
        )
    return number


def _machine_memory(root: Path) -> int | None:
    kilobytes = _numbers(root / "proc/meminfo")
    # MemAvailable counts caches that the system gives up; free pages alone would say far too little.
    if "MemAvailable:" in kilobytes:
        # What the file calls kB are 1024 bytes.
        return 1024 * (kilobytes["MemAvailable:"] + kilobytes.get("SwapFree:", 0))
    for name in ("SC_AVPHYS_PAGES", "SC_PHYS_PAGES"):
        if name in getattr(os, "sysconf_names", {}):
            return os.sysconf(name) * os.sysconf("SC_PAGE_SIZE")
    return None


def _group_memory(root: Path) -> Iterator[int]:
    """What the control groups of this process leave: its own and all above, which bound it too."""
    # Names of the limit, of what is used, and of what of that can be given up: version 2 of control groups, and version
    # 1, which older systems have.
    names = ("memory.max", "memory.current", "inactive_file")
    old_names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    try:
        lines = (root / "proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        # The one line of version 2 names no controllers; version 1 has a line for each set of them.
        if controllers == "":
            yield from _limits(root / "sys/fs/cgroup", path, *names)
        elif "memory" in controllers.split(","):
            yield from _limits(root / "sys/fs/cgroup/memory", path, *old_names)


def _limits(mount: Path, path: str, limit: str, usage: str, reclaimable: str) -> Iterator[int]:
    group = mount / path.lstrip("/")
    # Inside a container the path may be that on the host, of which some folders are not there; these are passed over.
    for folder in (group, *group.parents):
        if not folder.is_relative_to(mount):
            return
        try:
            most, used = int((folder / limit).read_text()), int((folder / usage).read_text())
        except (OSError, ValueError):  # no such group here, or its limit is "max"
            continue
        # Cached files count as used, and are given up first.
        yield most - used + _numbers(folder / "memory.stat").get(reclaimable, 0)


def _numbers(path: Path) -> dict[str, int]:
    """First two words of each line of a file: a name and a whole number; empty if there is no such file."""
    try:
        rows = [line.split() for line in path.read_text().splitlines()]
    except OSError:
        return {}
    return {row[0]: int(row[1]) for row in rows if len(row) > 1 and row[1].isdecimal()}
