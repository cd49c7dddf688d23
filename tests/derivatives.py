"""Derivatives of a function in both modes from one evaluation of it, so that a test compiles it once."""

from typing import Any

import jax


def derivatives_at(function, value, direction, pull=None) -> tuple[Any, Any, Any]:
    """The function's value, its derivative along a direction, and what reverse mode makes of `pull`.

    Reverse mode is the transpose of the linear map that forward mode applies; `jax.vjp` does the same, but evaluates
    the function once more. Without `pull`, the third is the function that makes it.
    """
    found, along = jax.linearize(function, value)

    def back_of(pull):
        # JAX asks a function that it transposes for its name: `along` itself would print its whole program for that.
        return jax.linear_transpose(lambda change: along(change), value)(pull)[0]

    return found, along(direction), back_of if pull is None else back_of(pull)
