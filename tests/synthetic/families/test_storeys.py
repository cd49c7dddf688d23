"""Storeys of one plan."""

import numpy as np

from voxjax.synthetic.families import make_place


def test_another_storey_has_the_same_walls_and_no_piece_of_furniture_in_common():
    place = make_place("storeys", 3)
    this, other = (place.scene(np.random.default_rng(0), share).solids for share in (0.0, 1.0))
    walls, others = (solids.footprint[solids.kind != "furniture"] for solids in (this, other))
    np.testing.assert_array_equal(walls, others)
    here, there = (
        {tuple(f.round(6).ravel()) for f in s.footprint[s.kind == "furniture"]} for s in (this, other)
    )
    assert len(here) > 5
    assert len(there) > 5
    assert not here & there


def test_the_way_leads_through_all_rooms():
    place = make_place("storeys", 4)
    extent = np.ptp(place.path[:, :2], axis=0)
    walls = np.concatenate([part[0] for part in place.fixed if part[3] == "wall"])
    assert (extent > 0.55 * np.ptp(walls, axis=0)).all()
