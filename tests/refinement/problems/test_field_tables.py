"""Fields near the surfaces of a map against its states and the definition of nearness."""

import numpy as np
from scipy import ndimage

from near_fields import dense_field
from voxjax.maps.prepared import FIELD_RADIUS
from voxjax.refinement.problems.field_tables import distance_field_of, opinion_field_of
from voxjax.refinement.problems.parts import surface_of
from voxjax.refinement.problems.views import hard_view


def values_of(field, grid):
    """The value of each voxel of the map."""
    return np.asarray(field.values)[rows_of(field, grid)]


def rows_of(field, grid):
    """The row of the values of each voxel of the map."""
    return dense_field(np.asarray(field.rows), grid.shape, np.asarray(field.table))


def test_opinions_are_the_states_but_unknown_far_from_surfaces(prepared):
    grid = prepared[0].grid
    states = np.asarray(grid.states)
    expected = np.where(states == 2, 1.0, np.where(states == 1, -1.0, 0.0))
    field = opinion_field_of(prepared[0])
    np.testing.assert_array_equal(values_of(field, grid), expected)
    near = np.asarray(ndimage.distance_transform_edt(states != 2)) ** 2 <= 3.0**2 + 1e-6
    # Free voxels beyond the band share one value, so that a derivative is as short as the surface.
    far = rows_of(field, grid)[(states == 1) & ~near]
    assert far.size > 0
    assert set(far.tolist()) == {1}


def test_distances_vanish_on_surfaces_and_end_at_the_reach(prepared):
    grid = prepared[0].grid
    states = np.asarray(grid.states)
    values = values_of(
        distance_field_of(prepared[0], surface_of(hard_view(prepared[0]), is_signed=True)), grid
    )
    gap = np.asarray(ndimage.distance_transform_edt(states != 2))
    assert np.percentile(np.abs(values[states == 2]), 95) < grid.voxel_size
    np.testing.assert_allclose(values[gap > FIELD_RADIUS], FIELD_RADIUS * grid.voxel_size, rtol=1e-5)
