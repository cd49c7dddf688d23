"""Maps in common tables are read as each map alone is."""

import jax.numpy as jnp
import numpy as np
import pytest

from voxjax.ops.blocks.block_builder import blocks_of
from voxjax.refinement.residuals.atlas import AtlasField
from voxjax.refinement.residuals.fields import Field, cells_around

SIZE = np.asarray(0.2, np.float32)


def some_field(seed, dims):
    """A field of random values, in a box of its own."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=50).astype(np.float32)
    blocks = blocks_of(rng.integers(1, 50, dims).astype(np.int32))
    origin, outside = rng.normal(size=3).astype(np.float32), np.asarray(seed, np.int32)
    rows, table = blocks.pool.reshape(-1), blocks.table.reshape(-1)
    return Field(rows, np.asarray(dims, np.int32), origin, SIZE, values, outside, table)


@pytest.mark.parametrize("which", [0, 1])
def test_a_field_of_an_atlas_equals_the_field_alone(which):
    fields = [some_field(3, (15, 4, 16)), some_field(7, (3, 18, 12))]
    rows = np.concatenate([fields[0].rows, fields[1].rows + 50])
    values = np.concatenate([field.values for field in fields])
    own = fields[which]
    tables = [np.asarray(field.table) for field in fields]
    table = np.concatenate([tables[0], tables[1] + np.int32(len(fields[0].rows) // 512)])
    first, shift = (0, 0) if which == 0 else (len(tables[0]), 50)
    dims, outside = np.asarray([*own.dims, first], np.int32), np.asarray(own.outside + shift, np.int32)
    common = AtlasField(rows, dims, own.origin, SIZE, values, outside, table)
    points = own.origin + SIZE * np.random.default_rng(1).uniform(-2, np.asarray(own.dims) + 2, (60, 3))
    places = [jnp.asarray(column, jnp.float32) for column in points.T]
    for one, other in zip(cells_around(common, places).values, cells_around(own, places).values, strict=True):
        np.testing.assert_array_equal(one, other)
