"""Where work is done: the one question that chooses between the host's form of an operation and the device's.

Operations that have both forms ask it themselves, so that no stage above `voxjax.ops` knows on what it runs.
"""

from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from .forks import refuse_after_fork


def backend() -> str:
    """Name of the platform that JAX computes on by default: "cpu", "gpu", ..."""
    # Whatever stands outside the public functions asks this before its first kernel.
    refuse_after_fork()
    return jax.default_backend()


def on_host(*arrays: object) -> bool:
    """Whether the default device is a CPU and none of some arrays (or trees of them) is traced.

    A CPU reads the host's memory, so NumPy may share the work and pieces may run side by side on all cores; under a
    transformation of JAX, and on accelerators, an operation has to be one kernel.
    """
    # Traced arrays are looked for in trees, because arguments are often named tuples of arrays.
    return backend() == "cpu" and not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(arrays))


def is_traced(value: object) -> bool:
    """Whether a value is known only once the program runs: under jit, grad, vmap."""
    return isinstance(value, Tracer)


def are_numpy(*arrays: object) -> bool:
    """Whether all leaves of some trees are NumPy arrays, whose length may be padded before a kernel sees it."""
    return all(isinstance(leaf, np.ndarray) for leaf in jax.tree.leaves(arrays))


def to_device(values: Any) -> Any:
    """A tree of host values as device arrays of the same dtypes.

    `jnp.asarray` traces a conversion for each shape that it takes in; putting values there compiles nothing.
    """
    return jax.device_put(values)
