"""Intermediate arrays that are written down once, however many later steps read them."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from .._types import Array


def materialized(
    compute: Callable[..., Any], is_valid: Bool[Array, ""] | np.bool_ | bool, *operands: Any
) -> Any:
    """What `compute(*operands)` gives, computed once and written to memory before anything reads it.

    XLA fuses what it takes for cheap into each of the steps that read it, and then computes it as often: on a CPU,
    three sums over looked-up values find out three times more where the points lie under a pose.
    `optimization_barrier` does not help, for it is gone before loops are fused; a branch whose condition is known at
    run time only stays a call with results of its own. Under `vmap` it becomes a choice, and all is fused again.

    Args:
        compute: A function whose results are arrays; what it closes over may be traced.
        is_valid: A condition that always holds, but that a compiler cannot know, as that a length is positive. Where
            it does not hold, all results are 0.
        operands: Arguments of `compute`.
    """
    shapes = jax.eval_shape(compute, *operands)

    def nothing(*operands: Any) -> Any:
        del operands
        return jax.tree.map(lambda result: jnp.zeros(result.shape, result.dtype), shapes)

    # The other branch has to give the same shapes; it never runs.
    return jax.lax.cond(is_valid, compute, nothing, *operands)
