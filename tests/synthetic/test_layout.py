import numpy as np

from solid_points import is_solid
from voxjax.synthetic import make_building


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


def test_straight_walls_meet_at_right_angles_and_skewed_ones_do_not():
    for skew in (0.0, 0.3):
        building = make_building(2, skew=skew)
        normals = building.corners.normals[building.corners.kind == "room"]
        cosine = np.abs(np.einsum("ni,ni->n", normals[:, 0], normals[:, 1]))
        assert (cosine.max() > 0.05) if skew else (cosine.max() < 1e-9)
