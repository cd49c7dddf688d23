"""Products of float32 matrices in float32: JAX lets GPUs round their factors to TF32, which has ten bits."""

import functools
from collections.abc import Callable
from typing import Any, TypeVar, cast

import jax

F = TypeVar("F", bound=Callable[..., Any])


def in_full_precision(function: F) -> F:
    """A function whose matrix products keep all digits of their factors on every device.

    It stands inside of `jax.jit`, where the function is traced: the precision is part of each product, and so of its
    derivatives. Rotated coordinates in TF32 would be off by centimetres at some tens of metres.
    """

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        with jax.default_matmul_precision("highest"):
            return function(*args, **kwargs)

    return cast(F, call)
