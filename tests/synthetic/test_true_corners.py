import itertools

import numpy as np

from solid_points import is_solid

BESIDE = 0.02  # metres


def test_every_corner_has_free_space_before_it(building):
    corners = building.corners
    outside = corners.position + BESIDE * corners.normals.sum(axis=1)
    assert not is_solid(building, outside).any()


def test_each_face_of_a_corner_parts_solid_from_free_space(building):
    corners = building.corners
    for face in range(3):
        others = [f for f in range(3) if f != face]
        is_face = np.zeros(len(corners.kind), bool)
        for signs in itertools.product((-1.0, 1.0), repeat=2):
            beside = sum(s * corners.normals[:, f] for s, f in zip(signs, others, strict=True))
            behind = corners.position + BESIDE * (beside - corners.normals[:, face])
            before = corners.position + BESIDE * (beside + corners.normals[:, face])
            is_face |= is_solid(building, behind) & ~is_solid(building, before)
        assert is_face.all()


def test_corner_normals_are_unit_and_independent(building):
    normals = building.corners.normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-9)
    assert (np.abs(np.linalg.det(normals)) > 0.5).all()


def test_every_room_has_eight_corners_and_every_kind_occurs(building):
    kinds = building.corners.kind
    assert np.count_nonzero(kinds == "room") == 8 * building.num_rooms
    assert set(kinds) == {"room", "furniture", "opening"}
