from typing import Any, cast

import jax
import jax.numpy as jnp
import pytest

from voxjax._runtime.precision import in_full_precision


@jax.jit
@in_full_precision
def product(a, b):
    """Of two matrices."""
    return a @ b


@pytest.mark.parametrize("setting", [None, "tensorfloat32"])
def test_products_and_their_derivatives_ask_for_all_digits_whatever_the_caller_has_set(setting):
    square, options = jnp.eye(3), cast(Any, jax.config)

    def slope(a, b):
        return jax.grad(lambda a: jnp.sum(product(a, b) ** 2))(a)

    with jax.default_matmul_precision(setting):
        text = jax.jit(slope).lower(square, square).as_text()
        assert options.jax_default_matmul_precision == setting
    products = [line for line in text.splitlines() if "dot_general" in line]
    assert len(products) == 2
    assert all("HIGHEST, HIGHEST" in line for line in products)
    assert product.__doc__ == "Of two matrices."
