"""Places and pairs of maps by the name of their family."""

import numpy as np
import pytest

from voxjax import InputError
from voxjax.synthetic import measure_overlap
from voxjax.synthetic.families import FAMILIES, PLACES, make_place, simulate_family
from voxjax.synthetic.families.visitor import walk


@pytest.mark.parametrize("kind", PLACES)
def test_places_are_made_of_convex_solids_and_their_way_is_clear(kind):
    place = make_place(kind, 7)
    solids = place.scene(np.random.default_rng(0), 0.5).solids
    ahead = np.roll(solids.footprint, -1, axis=1) - solids.footprint
    after = np.roll(ahead, -1, axis=1)
    # Going round counterclockwise, each side turns to the left of the one before it.
    assert (ahead[..., 0] * after[..., 1] - ahead[..., 1] * after[..., 0] > 0.0).all()
    assert (solids.z_range[:, 1] > solids.z_range[:, 0]).all()
    poses = walk(np.random.default_rng(1), place, place.scene(np.random.default_rng(2)))
    length = np.linalg.norm(np.diff(place.path, axis=0), axis=1).sum()
    # Furniture stands in the way of some poses, and of few.
    assert len(poses) > 0.7 * length / place.step
    # Both maps of a pair that hardly overlaps have place on it.
    assert len(poses) * place.step > 1.9 * place.extent[0]


@pytest.mark.parametrize("kind", PLACES)
def test_a_seed_gives_one_place_and_a_style_is_shared_by_many(kind):
    def solids(seed, style=None):
        return make_place(kind, seed, style=style).scene(np.random.default_rng(0)).solids.footprint

    first = solids(1)
    np.testing.assert_array_equal(first, solids(1))
    other = solids(2)
    assert first.shape != other.shape or not np.array_equal(first, other)
    styled = solids(2, 1)
    assert styled.shape != other.shape or not np.array_equal(styled, other)


@pytest.fixture(scope="module")
def rooms():
    return simulate_family("room", 3, overlap=0.5)


def test_the_same_seed_gives_the_same_maps(rooms):
    again = simulate_family("room", 3, overlap=0.5)
    for a, b in zip(rooms.grids, again.grids, strict=True):
        np.testing.assert_array_equal(a.states, b.states)
    np.testing.assert_array_equal(rooms.T_a_b, again.T_a_b)


def test_the_truth_lays_the_maps_onto_each_other_by_the_share_that_was_asked_for(rooms):
    a, b = rooms.grids
    overlap = min(measure_overlap(a, b, rooms.T_a_b), measure_overlap(b, a, np.linalg.inv(rooms.T_a_b)))
    assert 0.35 < overlap < 0.65
    T = np.array(rooms.T_a_b)
    T[:3, 3] += 0.3
    assert measure_overlap(a, b, T) < 0.5 * overlap


@pytest.mark.parametrize("family", ["tunnel", "stairwell", "scans", "sensors"])
def test_families_of_all_kinds_of_surveys_overlap_as_asked_for(family):
    found = simulate_family(family, 11, overlap=0.3, frame="so3", has_free_space=False)
    a, b = found.grids
    assert found.T_a_b is not None
    assert min(a.num_occupied, b.num_occupied) > 1500
    assert (a.voxel_size == b.voxel_size) == (family != "sensors")
    overlap = min(measure_overlap(a, b, found.T_a_b), measure_overlap(b, a, np.linalg.inv(found.T_a_b)))
    assert 0.2 < overlap < 0.4


def test_maps_of_two_places_have_no_truth():
    assert simulate_family("room", 3, elsewhere=True, has_free_space=False).T_a_b is None


def test_an_unknown_family_is_refused():
    with pytest.raises(InputError, match=f"family must be one of {FAMILIES[0]}.*got 'castle'"):
        simulate_family("castle", 0)
    with pytest.raises(InputError, match=r"kind must be one of .*got 'scans'"):
        make_place("scans", 0)
