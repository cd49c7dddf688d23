"""Maps in common tables are read as each map alone is."""

import jax.numpy as jnp
import numpy as np
import pytest

from voxjax.refinement.residuals.atlas import AtlasField
from voxjax.refinement.residuals.fields import Field, cells_around

SIZE = np.asarray(0.2, np.float32)


def some_field(seed, dims):
    """A field of random values, in a block of its own."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=50).astype(np.float32)
    rows = rng.integers(0, 50, int(np.prod(dims))).astype(np.int32)
    origin = rng.normal(size=3).astype(np.float32)
    return Field(rows, np.asarray(dims, np.int32), origin, SIZE, values, np.asarray(seed, np.int32))


@pytest.mark.parametrize("which", [0, 1])
def test_a_field_of_an_atlas_equals_the_field_alone(which):
    fields = [some_field(3, (5, 4, 6)), some_field(7, (3, 8, 2))]
    rows = np.concatenate([fields[0].rows, fields[1].rows + 50])
    values = np.concatenate([field.values for field in fields])
    own = fields[which]
    first, shift = (0, 0) if which == 0 else (len(fields[0].rows), 50)
    dims = np.asarray([*own.dims, first], np.int32)
    common = AtlasField(rows, dims, own.origin, SIZE, values, np.asarray(own.outside + shift, np.int32))
    points = own.origin + SIZE * np.random.default_rng(1).uniform(-2, np.asarray(own.dims) + 2, (60, 3))
    places = [jnp.asarray(column, jnp.float32) for column in points.T]
    for one, other in zip(cells_around(common, places).values, cells_around(own, places).values, strict=True):
        np.testing.assert_array_equal(one, other)
