"""Where closed buildings are cut open: upright, leaning and on their heads; what is open stays whole."""

import numpy as np
import pytest

from oracles.motions import turned
from voxjax.view.ceiling import ceiling_cut, find_cut

ABOVE, ASIDE = (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)


def _room():
    room = np.zeros((60, 40, 20), bool)
    room[:, :, [0, 19]] = room[[0, 59]] = room[:, [0, 39]] = True
    return room


def _street():
    """Ground, and houses on both sides of it with gaps between them."""
    street = np.zeros((90, 40, 30), bool)
    street[:, :, 0] = street[:45, 0] = street[70:, 0, :20] = street[20:60, 39] = street[75:, 39] = True
    return street


def _found(index, **options):
    """The cut of a map that has one."""
    cut = find_cut(index, **options)
    assert cut is not None
    return cut


def _index(occupied, T):
    """The voxels of a map that was turned, in lexicographic order."""
    fine = np.argwhere(occupied.repeat(2, 0).repeat(2, 1).repeat(2, 2)) / 2.0
    return np.unique(np.round(fine @ T[:3, :3].T).astype(np.int64), axis=0)


def test_a_ceiling_is_cut_and_an_open_terrain_is_not():
    room = _room()
    assert ceiling_cut(room) == 14
    cut = _found(np.argwhere(room), eye=ABOVE)
    assert cut.is_upright
    assert cut.height == 14
    terrain = np.zeros((30, 30, 20), bool)
    terrain[:, :, 0] = terrain[15, 15, :] = True
    nothing = np.zeros((3, 3, 3), bool)
    # Of two houses on a hill the upper one is no ceiling of the lower one.
    hill = np.zeros((2 * room.shape[0], room.shape[1], 60), bool)
    hill[: room.shape[0], :, :20], hill[room.shape[0] :, :, 40:] = room, room
    for whole in (terrain, nothing, hill):
        assert ceiling_cut(whole) == whole.shape[2]
        assert find_cut(np.argwhere(whole), eye=ABOVE) is None


@pytest.mark.parametrize(
    ("axis", "degrees"), [("x", 4), ("x", -7), ("y", 10), ("y", 25), ("x", -40), ("x", 170), ("y", 180)]
)
@pytest.mark.parametrize("eye", [ABOVE, ASIDE])
def test_a_leaning_room_loses_what_of_it_hides_the_rest(axis, degrees, eye):
    T = turned(axis, degrees, (0.0, 0.0, 0.0), degrees=True)
    index = _index(_room(), T)
    height = index @ T[:3, 2]
    cut = _found(index, eye=eye)
    is_kept = cut.keeps(index)
    low, high = height < height.min() + 2.0, height > height.max() - 2.0
    # Of a room that lies on its head, the floor is nearer to the eye.
    hiding, seen = (high, low) if T[:3, 2] @ np.asarray(eye) > 0.0 else (low, high)
    assert not is_kept[hiding].any()
    assert is_kept[seen].all()
    assert 0.5 < is_kept.mean() < 0.75


def test_a_room_that_is_seen_along_its_ceiling_stays_whole():
    index = _index(_room(), turned("x", 60, (0.0, 0.0, 0.0), degrees=True))
    assert find_cut(index, eye=(1.0, 0.0, 0.0)) is None
    cut = _found(index, eye=(0.0, -1.0, 0.0))
    np.testing.assert_allclose(cut.up, (0.0, -np.sin(np.radians(60)), np.cos(np.radians(60))), atol=0.02)


@pytest.mark.parametrize(("axis", "degrees"), [("z", 15), ("x", 5), ("y", 9), ("x", 35), ("y", 60)])
def test_a_street_is_closed_between_its_houses_and_stays_whole(axis, degrees):
    index = _index(_street(), turned(axis, degrees, (0.0, 0.0, 0.0), degrees=True))
    assert find_cut(index, eye=ABOVE) is None
    assert find_cut(index, eye=ASIDE) is None


def test_a_tower_loses_its_top_and_a_house_on_its_side_its_ceiling():
    tower = np.zeros((30, 30, 45), bool)
    tower[:, :, [0, 44]] = tower[[0, 29]] = tower[:, [0, 29]] = True
    assert _found(np.argwhere(tower), eye=ASIDE).is_upright
    house = np.transpose(np.pad(_room(), 1), (2, 0, 1))
    cut = _found(np.argwhere(house), eye=ASIDE)
    np.testing.assert_allclose(cut.up, (1.0, 0.0, 0.0), atol=1e-3)


def test_without_planes_z_is_up():
    # A cave: two rough skins above each other, without level pieces.
    x, y = np.meshgrid(np.arange(64), np.arange(64), indexing="ij")
    rough = np.random.default_rng(0).integers(0, 12, (64, 64))
    floor, top = np.stack([x, y, rough], -1), np.stack([x, y, 60 + rough], -1)
    index = np.unique(np.concatenate([floor.reshape(-1, 3), top.reshape(-1, 3)]), axis=0)
    cut = _found(index, eye=ASIDE)
    assert cut.is_upright
    assert cut.keeps(index).mean() == 0.5
