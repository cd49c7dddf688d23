import itertools

import numpy as np
import pytest

from voxjax.synthetic import make_building, make_hotel
from voxjax.synthetic.building import close_doors

BESIDE = 0.02  # metres


@pytest.fixture(scope="module", params=["straight", "skewed", "hotel"])
def building(request):
    if request.param == "hotel":
        return make_hotel(4)
    return make_building(11, skew=0.3 if request.param == "skewed" else 0.0, clutter=1.5)


def is_solid(building, points):
    return (building.solids.distance(points) < 0).any(axis=1)


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


def test_all_rooms_are_joined_by_doors_that_lead_through_walls(building):
    reached, front = {0}, [0]
    while front:
        new = set(building.neighbours(front.pop())) - reached
        reached |= new
        front += new
    assert reached == set(range(building.num_rooms))
    through = np.asarray(
        [[*(d.centre + s * d.normal), 1.0] for d in building.plan.doors for s in np.linspace(-0.6, 0.6, 25)]
    )
    assert not is_solid(building, through).any()


def test_furniture_stands_inside_rooms_and_apart(building):
    walls = building.solids.kind == "wall"
    for piece in building.furniture:
        middle = np.asarray([[*piece[0].footprint.mean(axis=0), 0.5]])
        assert not (building.solids.distance(middle)[0, walls] < 0).any()
    centres = np.asarray([piece[0].footprint.mean(axis=0) for piece in building.furniture])
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 10.0 * np.eye(len(centres))
    assert gaps.min() > 0.5


def test_straight_walls_meet_at_right_angles_and_skewed_ones_do_not():
    for skew in (0.0, 0.3):
        building = make_building(2, skew=skew)
        normals = building.corners.normals[building.corners.kind == "room"]
        cosine = np.abs(np.einsum("ni,ni->n", normals[:, 0], normals[:, 1]))
        assert (cosine.max() > 0.05) if skew else (cosine.max() < 1e-9)


def test_hotel_rooms_are_equal_up_to_half_a_turn():
    hotel = make_hotel(7, moved_share=0.0)
    shapes, furniture = [], []
    for index, room in enumerate(hotel.plan.rooms):
        if room.is_corridor:
            continue
        sign = 1.0 if index < 4 else -1.0
        centre = room.polygon.mean(axis=0)
        shapes.append(np.sort(np.round(sign * (room.polygon - centre), 6), axis=0))
        inside = [p[0] for p in hotel.furniture if np.abs(p[0].footprint.mean(axis=0) - centre).max() < 3.0]
        inside = [i for i in inside if _is_within(i.footprint.mean(axis=0), room.polygon)]
        furniture.append(
            sorted(tuple(np.round(sign * (i.footprint.mean(axis=0) - centre), 6)) for i in inside)
        )
    assert all(np.array_equal(shape, shapes[0]) for shape in shapes)
    assert len(furniture[0]) > 0
    assert all(f == furniture[0] for f in furniture)


def _is_within(point, polygon):
    return (polygon.min(axis=0) < point).all() and (point < polygon.max(axis=0)).all()


def test_moved_share_moves_furniture():
    kept = make_hotel(7, moved_share=0.0)
    moved = make_hotel(7, moved_share=0.5)
    spots = {tuple(np.round(p[0].footprint[0], 6)) for p in kept.furniture}
    same = sum(tuple(np.round(p[0].footprint[0], 6)) in spots for p in moved.furniture)
    assert 0.2 < same / len(spots) < 0.8


def test_same_seed_gives_the_same_building_and_another_seed_another():
    first, again, other = make_building(5), make_building(5), make_building(6)
    assert np.array_equal(first.solids.footprint, again.solids.footprint)
    assert np.array_equal(first.corners.position, again.corners.position)
    assert first.solids.footprint.shape != other.solids.footprint.shape or not np.array_equal(
        first.solids.footprint, other.solids.footprint
    )


def test_doors_close_only_where_the_robot_does_not_pass(building):
    door = building.plan.doors[0]
    other = close_doors(building, [], np.random.default_rng(0), 1.0)
    own = close_doors(building, list(door.rooms), np.random.default_rng(0), 1.0)
    middle = np.asarray([[*door.centre, 1.0]])
    assert is_solid(other, middle).all()
    assert not is_solid(own, middle).any()
    assert np.count_nonzero(other.solids.kind == "door") == len(building.plan.doors)
    assert len(close_doors(building, [], np.random.default_rng(0), 0.0).solids.kind) == len(
        building.solids.kind
    )
