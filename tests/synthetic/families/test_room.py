"""Rooms for depth cameras."""

from voxjax.synthetic.families import make_place


def test_small_things_stand_on_the_furniture():
    place = make_place("room", 0)
    laden = [piece for usual, _ in place.pieces for piece in [usual] if any(p[3] == "thing" for p in piece)]
    assert len(laden) > 3
    for piece in laden:
        things = [part for part in piece if part[3] == "thing"]
        assert {part[1] for part in things} == {piece[0][2]}
        for thing in things:
            middle = thing[0].mean(axis=0)
            assert (middle > piece[0][0].min(axis=0)).all()
            assert (middle < piece[0][0].max(axis=0)).all()
