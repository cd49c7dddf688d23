"""Fields between voxel centres: exact for linear functions, and what is outside."""

import jax.numpy as jnp
import numpy as np

from voxjax.refinement.residuals.fields import Field, cells_around

DIMS, ORIGIN, SIZE, SLOPE = (5, 4, 6), np.asarray([1.0, -2.0, 0.5]), 0.5, np.asarray([0.3, -1.1, 0.7])


def linear_field():
    """A field whose value at each voxel centre is a linear function of the place; outside it is 9."""
    index = np.stack(np.unravel_index(np.arange(np.prod(DIMS)), DIMS), axis=-1)
    values = np.concatenate([[9.0], (ORIGIN + (index + 0.5) * SIZE) @ SLOPE]).astype(np.float32)
    rows = np.arange(1, len(values), dtype=np.int32)
    dims, origin = np.asarray(DIMS, np.int32), ORIGIN.astype(np.float32)
    return Field(rows, dims, origin, np.asarray(SIZE, np.float32), values, np.asarray(0, np.int32))


def columns(points):
    return [jnp.asarray(column, jnp.float32) for column in points.T]


def test_a_linear_field_is_read_exactly_between_centres():
    rng = np.random.default_rng(0)
    points = ORIGIN + SIZE * rng.uniform(0.5, np.asarray(DIMS) - 0.5, (40, 3))
    found = cells_around(linear_field(), columns(points)).at(columns(points))
    np.testing.assert_allclose(found, points @ SLOPE, atol=1e-5)


def test_outside_of_the_block_all_corners_hold_what_is_outside():
    points = np.stack([ORIGIN - 3.0, ORIGIN + SIZE * np.asarray(DIMS) + 2.0])
    for value in cells_around(linear_field(), columns(points)).values:
        np.testing.assert_array_equal(value, 9.0)
