import numpy as np

from voxjax.synthetic import make_hotel


def test_furniture_stands_inside_rooms_and_apart(building):
    walls = building.solids.kind == "wall"
    for piece in building.furniture:
        middle = np.asarray([[*piece[0].footprint.mean(axis=0), 0.5]])
        assert not (building.solids.distance(middle)[0, walls] < 0).any()
    centres = np.asarray([piece[0].footprint.mean(axis=0) for piece in building.furniture])
    gaps = np.linalg.norm(centres[:, None] - centres[None], axis=-1) + 10.0 * np.eye(len(centres))
    assert gaps.min() > 0.5


def test_moved_share_moves_furniture():
    kept = make_hotel(7, moved_share=0.0)
    moved = make_hotel(7, moved_share=0.5)
    spots = {tuple(np.round(p[0].footprint[0], 6)) for p in kept.furniture}
    same = sum(tuple(np.round(p[0].footprint[0], 6)) in spots for p in moved.furniture)
    assert 0.2 < same / len(spots) < 0.8
