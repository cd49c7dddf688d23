"""Labelled pairs of the families."""

import numpy as np
import pytest
from bench.families import FAMILIES, ROLES, FamilyPair, family_pair, main, mirrored, roles_of

from small_worlds import draw_map
from voxjax import InputError


@pytest.fixture(scope="module")
def pairs():
    return {role: family_pair("room", role, 2, has_free_space=False) for role in roles_of("room")}


def test_pairs_of_one_place_have_a_truth_and_their_overlap(pairs):
    for role, pair in pairs.items():
        assert isinstance(pair, FamilyPair)
        assert pair.role == role
        assert pair.a.num_occupied > 500
        assert pair.a.num_free == 0
        assert (pair.T_a_b is not None) == (role in ("same", "changed"))
        assert (pair.overlap > 0.1) == (role in ("same", "changed"))


def test_a_scaled_pair_is_the_pair_of_one_place_with_a_larger_or_smaller_map(pairs):
    same, scaled = family_pair("room", "mirrored", 2, has_free_space=False), pairs["scaled"]
    np.testing.assert_array_equal(scaled.a.states, same.a.states)
    assert scaled.b.num_occupied == same.b.num_occupied
    np.testing.assert_allclose(scaled.b.voxel_size, scaled.factor * same.b.voxel_size)
    factors = [family_pair("room", "scaled", seed, has_free_space=False).factor for seed in range(3)]
    assert all(0.89 < factor < 0.99 or 1.01 < factor < 1.11 for factor in factors)
    assert len(set(factors)) == 3


def test_a_mirrored_map_is_a_mirror():
    grid = draw_map()
    for axis in range(3):
        turned = mirrored(grid, axis)
        np.testing.assert_array_equal(np.flip(np.asarray(turned.states), axis), grid.states)
        assert not np.array_equal(turned.states, grid.states)
        twice = mirrored(turned, axis)
        np.testing.assert_array_equal(twice.states, grid.states)
        # The box stays where it was.
        np.testing.assert_array_equal(turned.origin, grid.origin)


def test_only_storeys_have_another_storey():
    assert [family for family in FAMILIES if "storey" in roles_of(family)] == ["storeys"]
    assert roles_of("storeys") == ROLES
    with pytest.raises(InputError, match=r"role must be one of same, .* for room, got 'storey'"):
        family_pair("room", "storey", 0)
    with pytest.raises(InputError, match=r"family must be one of .*got 'castle'"):
        family_pair("castle", "same", 0)


def test_the_command_draws_a_sheet_and_prints_a_row(tmp_path, capsys):
    overview = tmp_path / "overview.png"
    argv = ["--draw", str(tmp_path), "--family", "room", "--clouds", "--overview", str(overview)]
    assert main(argv) == 0
    assert overview.stat().st_size > 5_000
    assert (tmp_path / "room_same_0.png").stat().st_size > 10_000
    assert "room" in capsys.readouterr().out
