"""What a benchmark of kernels ran on: device, allocator, versions. It decides which results may be compared."""

import importlib.metadata
import os
import platform
import re
from pathlib import Path

import jax

TUNED = (
    "GLIBC_TUNABLES=glibc.malloc.hugetlb=1:glibc.malloc.mmap_max=0:glibc.malloc.trim_threshold=17179869184"
    ":glibc.malloc.arena_max=1"
)
"""Environment that spares the page faults of fresh arrays on Linux: huge pages, memory kept by the process, and one
arena for all threads, because what one of the compiler's threads gives back another one could not use."""


def device_name() -> str:
    """Kind of the first device, for people: the processor with its cores, or the accelerator."""
    device = jax.devices()[0]
    if device.platform != "cpu":
        return device.device_kind
    num_cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{_processor()}, {num_cores} cores"


def file_name(device: str) -> str:
    """Name of the file of results of a kind of device: letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", device.lower()).strip("-") + ".json"


def allocator() -> str:
    """Return "tuned" where the environment asks for huge pages that are kept, else "default"; on a GPU "device"."""
    if jax.devices()[0].platform != "cpu":
        return "device"
    settings = os.environ.get("GLIBC_TUNABLES", "") + os.environ.get("LD_PRELOAD", "")
    return "tuned" if re.search(r"hugetlb=[12]|jemalloc|tcmalloc", settings) else "default"


def describe() -> dict[str, str]:
    """All that a reader must know of where it ran, by name."""
    variables = ("GLIBC_TUNABLES", "LD_PRELOAD", "MALLOC_CONF", "XLA_PYTHON_CLIENT_ALLOCATOR", "XLA_FLAGS")
    found = {name: os.environ[name] for name in variables if os.environ.get(name)}
    # Where a library lies on this machine says nothing to others.
    found = {name: re.sub(r"/\S*/", "", value) for name, value in found.items()}
    return {
        "device": device_name(),
        "allocator": allocator(),
        **found,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in ("voxjax", "jax", "jaxlib", "numpy", "scipy")},
    }


def _processor() -> str:
    """Model of the processor, from the kernel's list where there is one."""
    listing = Path("/proc/cpuinfo")
    if listing.exists():
        model = re.search(r"^model name\s*:\s*(.+)$", listing.read_text(), re.MULTILINE)
        if model:
            return " ".join(model.group(1).split())
    return platform.processor() or platform.machine()
