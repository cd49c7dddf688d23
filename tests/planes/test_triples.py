"""Corners where three planes meet."""

import numpy as np

from hand_made_surfaces import SIZE, room_grid
from oracles import box_room
from voxjax.planes.extract import extract_planes
from voxjax.planes.triples import intersect_planes


def test_intersections_lie_on_their_planes_and_near_their_support():
    grid, _ = room_grid(box_room.rotation((0, 0, 1), 0.3))
    found = extract_planes(grid)
    triples = intersect_planes(found, reach=0.6, min_triple_product=0.4)
    normal, offset = np.asarray(found.planes.normal), np.asarray(found.planes.offset)
    assert len(triples.planes) >= 16
    gap = np.einsum("mij,mj->mi", normal[triples.planes], triples.position) - offset[triples.planes]
    assert np.abs(gap).max() < 1e-4
    for row in range(0, len(triples.planes), 5):
        for column in range(3):
            support = found.points[found.labels == triples.planes[row, column]]
            nearest = np.linalg.norm(support - triples.position[row], axis=1).min()
            # Support is thinned to one element in four voxels.
            assert nearest - 1e-5 <= triples.distance[row, column] <= nearest + 4 * SIZE * 3**0.5
    product = np.linalg.det(normal[triples.planes].astype(np.float64))
    np.testing.assert_allclose(triples.triple_product, product, atol=1e-5)
