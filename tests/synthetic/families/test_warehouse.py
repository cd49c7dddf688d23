"""Warehouses."""

import numpy as np

from voxjax.synthetic.families import make_place


def test_racks_are_equal_and_goods_stand_on_their_boards_or_on_the_floor():
    place = make_place("warehouse", 1)
    boards = [part for part in place.fixed if part[3] == "rack" and part[1] > 0.0]
    assert len({round(float(np.ptp(part[0][:, 0])), 6) for part in boards}) == 1
    levels = {0.0, *(round(part[2], 6) for part in boards)}
    goods = [part for usual, _ in place.pieces for part in usual]
    assert len(goods) > 50
    assert {round(part[1], 6) for part in goods} <= levels
    assert {round(part[1], 6) for part in goods} > {0.0}


def test_goods_change_from_day_to_day():
    place = make_place("warehouse", 2)
    this, other = (place.scene(np.random.default_rng(0), share).solids for share in (0.0, 1.0))
    before, after = (s.footprint[s.kind != "goods"] for s in (this, other))
    np.testing.assert_array_equal(before, after)
    assert len(this.kind) != len(other.kind) or not np.array_equal(this.footprint, other.footprint)
