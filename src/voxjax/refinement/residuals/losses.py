"""Robust losses: what a large offset costs, as a factor on the offset."""

from typing import Literal

import jax.numpy as jnp
from jaxtyping import Float

from ..._types import Array

Loss = Literal["geman_mcclure", "cauchy", "huber", "squared"]


def robustify(offset: Float[Array, "n 3"], loss: Loss) -> Float[Array, "n 3"]:
    """Shrink offsets [robust scale] so that their square is the robust loss; smooth at zero."""
    return offset * robust_factor(jnp.sum(offset * offset, axis=-1, keepdims=True), loss)


def robust_factor(squared: Float[Array, "*n"], loss: Loss) -> Float[Array, "*n"]:
    """What an offset is multiplied by so that its square is the robust loss.

    Args:
        squared: Square of the offset, in units of the robust scale squared.
        loss: What a large offset costs.
    """
    if loss == "squared":
        return jnp.ones_like(squared)
    if loss == "geman_mcclure":
        # Squared times the offset squared, this is s / (1 + s): bounded by 1.
        return 1.0 / jnp.sqrt(1.0 + squared)
    # Huber is quadratic up to 1; Cauchy's quotient below loses its digits near 0, where its series takes over.
    is_small = squared < (1.0 if loss == "huber" else 1e-4)
    # The branch that is not taken is differentiated as well: at 0 it would give NaN, at 1 it is harmless.
    squared_safe = jnp.where(is_small, jnp.ones_like(squared), squared)
    if loss == "huber":
        factor = jnp.sqrt(2.0 * jnp.sqrt(squared_safe) - 1.0) / jnp.sqrt(squared_safe)
        return jnp.where(is_small, jnp.ones_like(squared), factor)
    factor = jnp.sqrt(jnp.log1p(squared_safe) / squared_safe)
    return jnp.where(is_small, 1.0 - 0.25 * squared, factor)


def robust_slope(squared: Float[Array, "*n"], loss: Loss) -> Float[Array, "*n"]:
    """Derivative of the robust loss with respect to the squared offset: the weight that a point has left.

    Args:
        squared: Square of the offset, in units of the robust scale squared.
        loss: What a large offset costs.
    """
    if loss == "squared":
        return jnp.ones_like(squared)
    if loss == "geman_mcclure":
        return 1.0 / ((1.0 + squared) * (1.0 + squared))
    if loss == "cauchy":
        return 1.0 / (1.0 + squared)
    # Huber's loss is quadratic within the scale, where the weight is 1, and linear beyond.
    return 1.0 / jnp.sqrt(jnp.maximum(squared, 1.0))
