import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax._runtime.materialize import materialized

TABLE, ROWS = np.arange(64, dtype=np.float32) ** 2, np.asarray([3, 60, 5, 5, 0], np.int32)


def sums(table, rows, size):
    """Three sums over the same looked-up values."""
    found = materialized(lambda: jnp.asarray(table)[rows], size > 0)
    return jnp.stack([jnp.sum(found), jnp.sum(found * found), jnp.max(found)])


def expected(table, rows):
    found = table[rows]
    return np.asarray([found.sum(), (found * found).sum(), found.max()])


def test_values_are_those_of_the_function():
    found = jax.jit(sums)(TABLE, ROWS, np.float32(0.1))
    np.testing.assert_allclose(np.asarray(found), expected(TABLE, ROWS), rtol=1e-6)


def test_what_three_sums_read_is_computed_once():
    def counted(is_materialized):
        def sums(places, size):
            found = jnp.floor(places / size)
            if is_materialized:
                found = materialized(lambda: jnp.floor(places / size), size > 0)
            is_inside = (found >= 0) & (found < 9)
            return jnp.stack([jnp.sum(jnp.where(is_inside & (found > k), places, 0.0)) for k in range(3)])

        text = jax.jit(sums).lower(np.zeros(4096, np.float32), np.float32(0.1)).compile().as_text()
        assert text is not None
        return text.count(" floor(")

    assert counted(True) == 1
    assert counted(False) > 1, "the compiler does so by itself: `materialized` is not needed any more"


def test_a_condition_that_does_not_hold_gives_zeros():
    found = jax.jit(sums)(TABLE, ROWS, np.float32(-1.0))
    np.testing.assert_array_equal(np.asarray(found), np.zeros(3, np.float32))


@pytest.mark.parametrize("transform", [jax.jacfwd, jax.jacrev])
def test_derivatives_are_those_of_the_function(transform):
    found = np.asarray(transform(lambda table: sums(table, ROWS, np.float32(1.0)))(TABLE))
    slopes = np.zeros((3, len(TABLE)), np.float32)
    np.add.at(slopes[0], ROWS, 1.0)
    np.add.at(slopes[1], ROWS, 2.0 * TABLE[ROWS])
    slopes[2, 60] = 1.0
    np.testing.assert_allclose(found, slopes, rtol=1e-6)


def test_it_maps_over_a_batch_of_conditions_and_operands():
    rows = np.stack([ROWS, ROWS[::-1], ROWS])
    found = jax.vmap(sums, in_axes=(None, 0, 0))(TABLE, rows, np.asarray([1.0, 2.0, -1.0], np.float32))
    one = expected(TABLE, ROWS)
    np.testing.assert_allclose(np.asarray(found), [one, one, np.zeros(3)], rtol=1e-6)
