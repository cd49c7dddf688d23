"""Derivatives of a function in both modes from one evaluation of it, so that a test compiles it once."""

import jax


def derivatives_at(function, value, direction, pull=None):
    """The function's value, its derivative along a direction, and what reverse mode makes of `pull`, if given.

    Reverse mode is the transpose of the linear map that forward mode applies; `jax.vjp` does the same, but evaluates
    the function once more.
    """
    found, along = jax.linearize(function, value)
    # JAX asks a function that it transposes for its name: `along` itself would print its whole program for that.
    back = None if pull is None else jax.linear_transpose(lambda change: along(change), value)(pull)[0]
    return found, along(direction), back
