"""Timing that survives a noisy machine: rounds that interleave the candidates, medians, and what it ran on.

Method: each candidate is called once to compile (reported apart), then in `rounds` rounds every candidate
runs once, in an order that turns by one each round, so that slow spells of the machine hit all alike. The
median is reported with the quartiles. Device arrays are waited for.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import jax
import numpy as np

Item = TypeVar("Item")


@dataclass(frozen=True)
class Timing:
    """Times of one candidate.

    Attributes:
        name: Name of the candidate.
        first_s: Time of the first call, compilation included [s].
        median_s: Median of the later calls [s].
        low_s: Lower quartile [s].
        high_s: Upper quartile [s].
        rounds: Number of later calls.
    """

    name: str
    first_s: float
    median_s: float
    low_s: float
    high_s: float
    rounds: int

    def __str__(self) -> str:
        """One line: median, quartiles, first call."""
        median, low, high = map(format_seconds, (self.median_s, self.low_s, self.high_s))
        return f"{self.name:<36} {median:>10}   ({low} .. {high})   first call {self.first_s:.2f} s"


def time_interleaved(candidates: Mapping[str, Callable[[], object]], *, rounds: int = 7) -> list[Timing]:
    """Time several functions of no arguments against each other.

    Args:
        candidates: Functions by name; results are waited for with `jax.block_until_ready`.
        rounds: Number of timed calls of each candidate.

    Returns:
        One entry a candidate, in their order.
    """
    names = list(candidates)
    first = {name: _seconds(candidates[name]) for name in names}
    times: dict[str, list[float]] = {name: [] for name in names}
    for turn in range(rounds):
        for name in turned(names, turn):
            times[name].append(_seconds(candidates[name]))
    timings = []
    for name in names:
        low, median, high = np.percentile(times[name], (25.0, 50.0, 75.0))
        timings.append(Timing(name, first[name], float(median), float(low), float(high), rounds))
    return timings


def turned(items: Sequence[Item], turn: int) -> list[Item]:
    """Items in an order that begins one later with each turn, so that no item always comes first."""
    shift = turn % len(items)
    return [*items[shift:], *items[:shift]]


def round_count(text: str) -> int:
    """A number of rounds from the command line.

    Raises:
        argparse.ArgumentTypeError: If it is below 1, of which there is no median.
    """
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be 1 or more, got {number}")
    return number


def setting() -> str:
    """Lines that say what was measured on: device, allocator, cores, load, versions."""
    device = jax.devices()[0]
    stats = device.memory_stats() or {}
    limit = f", {stats['bytes_limit'] / 2**30:.1f} GiB for the allocator" if "bytes_limit" in stats else ""
    allocator = os.environ.get("XLA_PYTHON_CLIENT_ALLOCATOR", "default")
    preallocate = os.environ.get("XLA_PYTHON_CLIENT_PREALLOCATE", "default")
    versions = ", ".join(
        f"{name} {importlib.metadata.version(name)}" for name in ("voxjax", "jax", "jaxlib", "numpy")
    )
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return (
        f"device     {device.platform}: {device.device_kind}{limit}\n"
        f"allocator  {allocator}, preallocate {preallocate}\n"
        f"host       {os.cpu_count()} cores{load}, Python {platform.python_version()}\n"
        f"versions   {versions}"
    )


def peak_bytes() -> int | None:
    """Most device memory used so far [byte], where the device counts it."""
    return (jax.devices()[0].memory_stats() or {}).get("peak_bytes_in_use")


def format_seconds(seconds: float) -> str:
    """Seconds with a unit that suits their size."""
    for unit, scale in (("s", 1.0), ("ms", 1e3), ("us", 1e6)):
        if seconds * scale >= 1.0 or unit == "us":
            return f"{seconds * scale:.3g} {unit}"
    raise AssertionError


def _seconds(call: Callable[[], object]) -> float:
    """Wall time of one call, results waited for [s]."""
    # A call of JAX returns before its work is done.
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start
