import numpy as np

from solid_points import is_solid
from voxjax.synthetic import make_building, make_hotel
from voxjax.synthetic.building import close_doors


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
