"""Maps in millimetres and feet: named with the factor, and no map vanishes beside them."""

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map, pose
from voxjax._results import RESULTS
from voxjax.pipeline.units import in_odd_units

T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))
FIRST_ROUND = {"source": {"corners": False, "subgraph": False, "descriptors": False}}


@pytest.fixture(scope="module")
def maps():
    """Two overlapping parts of the building, in two frames."""
    a = draw_map(seen=((-0.3, -0.3, -0.3), (9.4, 4.3, 3.0)))
    return a, draw_map(T_MAP_WORLD, seen=((-0.3, -0.3, -0.3), (6.5, 8.4, 3.0)))


@pytest.mark.parametrize(
    ("factor", "words"), [(1000.0, "1,000 times too large"), (1 / 0.0254, "39.37 times")]
)
def test_a_map_in_another_unit_is_named_before_it_makes_the_other_one_vanish(maps, factor, words):
    found = vx.register(maps[0], maps[1].placed(scale=factor), config=FIRST_ROUND)
    assert found.verdict == "ambiguous"
    assert found.result == RESULTS.scaled
    assert words in found.reason
    assert found.reason == (
        f"Map b seems to be {factor:,.4g} times too large, as in another unit of length: with its lengths times "
        f"{1 / factor:.4g} it lies in map a with a score of {found.stats['scale']['scaled_score']:.2f}; give it with "
        "that scale (convert --scale, read_map(scale=))."
    )
    assert found.stats["scale"]["scale"] * factor == pytest.approx(1.0, abs=0.02)
    assert found.confidence == 0.0


def test_a_map_in_feet_is_named_once_it_was_refused(maps):
    found = vx.register(maps[0], maps[1].placed(scale=1 / 0.3048), config=FIRST_ROUND)
    assert found.verdict == "ambiguous"
    assert found.result == RESULTS.scaled
    assert "3.281 times too large" in found.reason
    # The pose of the map as it is is still there for who wants to look at it.
    assert found.hypotheses


def test_batches_name_the_unit_too(maps):
    scaled = maps[1].placed(scale=1000.0)
    one, other = vx.register_batch([(maps[0], scaled), (scaled, maps[0])], config=FIRST_ROUND)
    assert "1,000 times too large" in one.reason
    assert "1,000 times too small" in other.reason


def test_one_map_in_millimetres_does_not_keep_others_from_being_merged(maps):
    scaled = maps[1].placed(scale=1000.0)
    merged = vx.merge([maps[0], maps[1], scaled], config=FIRST_ROUND)
    assert merged.status == "partial"
    assert [pose is not None for pose in merged.poses] == [True, True, False]
    assert [found.accepted for _, _, found in merged.pairs] == [True, False, False]
    assert all("times too" in found.reason for _, _, found in merged.pairs[1:])


def test_maps_in_odd_units_are_told_from_the_rest(maps):
    scaled = maps[1].placed(scale=1000.0)
    assert in_odd_units([*maps, scaled]) == {2}
    assert in_odd_units([maps[0], scaled]) == {0, 1}
    assert in_odd_units(maps) == set()
    empty = vx.VoxelGrid(np.zeros((2, 2, 2), np.uint8), np.zeros(3), 100.0)
    assert in_odd_units([*maps, empty]) == set()
