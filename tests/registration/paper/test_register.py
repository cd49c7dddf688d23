import numpy as np
import pytest

import voxjax as vx
from corner_lists import corners_at
from oracles.motions import moved, pose_error, random_pose
from oracles.rooms import VOXEL, furnished_room
from voxjax.registration.paper import register as paper
from voxjax.registration.paper.register import register_paper
from voxjax.registration.paper.settings import PaperConfig

BOX_CORNERS = np.array(
    [
        [x, y, z]
        for low, high in (
            ((0.2, 0.2, 0.2), (5.2, 4.2, 2.8)),
            ((0.25, 0.25, 0.25), (1.15, 0.85, 0.95)),
            ((3.05, 0.25, 0.25), (4.45, 1.15, 1.55)),
            ((0.25, 2.85, 0.25), (1.55, 4.15, 0.65)),
            ((3.85, 3.05, 0.25), (5.15, 4.15, 1.95)),
            ((2.25, 1.85, 0.25), (3.05, 2.35, 0.85)),
        )
        for x in (low[0], high[0])
        for y in (low[1], high[1])
        for z in (high[2],)
    ]
)


@pytest.fixture(scope="module")
def maps():
    a = vx.VoxelGrid(furnished_room(), np.zeros(3, np.float32), VOXEL)
    T = random_pose(np.random.default_rng(11), metres=2, degrees=40)
    return a, a.transformed(np.linalg.inv(T)), T


@pytest.fixture
def known_corners(monkeypatch, maps):
    """The corners of the room as both maps would find them, so that matching is tested by itself."""
    a, b, T = maps
    noise = np.random.default_rng(5).normal(0, 0.3 * VOXEL, (2, *BOX_CORNERS.shape))

    def detect(grid, *, preset):
        assert preset == "paper"
        # The paper's pipeline works in local frames.
        if grid.shape == a.shape:
            return corners_at(BOX_CORNERS + noise[0] - a.localized()[1])
        in_b = moved(np.linalg.inv(T), BOX_CORNERS + noise[1])
        return corners_at((in_b - b.localized()[1])[::-1])

    monkeypatch.setattr(paper, "detect_corners", detect)


def test_known_corners_give_the_true_pose(maps, known_corners):
    a, b, T = maps
    found = register_paper(a, b)
    degrees, metres = pose_error(found.T_a_b, T, b.occupied_points().mean(axis=0))
    assert degrees < 0.7
    assert metres < 0.5 * VOXEL
    assert found.verdict == "accepted"
    assert found.stats["clique_size"] >= 20
    assert found.stats["search_completed"]
    assert found.hypotheses[0].evidence.occupied_agreement > 0.9
    assert np.linalg.eigvalsh(np.asarray(found.covariance)).min() > 0
    assert {"corners", "consistency", "search", "tie-break", "transform", "evidence"} == set(
        found.stats["seconds"]
    )


def test_a_spent_budget_is_reported(maps, known_corners):
    a, b, _ = maps
    found = register_paper(a, b, PaperConfig(max_nodes=30))
    assert not found.stats["search_completed"]
    assert found.result in (vx.RESULTS.budget_exhausted, vx.RESULTS.too_few_associations)


def test_a_pose_without_support_is_not_accepted(maps, monkeypatch):
    """The same six corners in both maps by accident: the maps' surfaces disagree."""
    a, b, _ = maps
    shared = np.random.default_rng(8).uniform(0, 4, (7, 3))
    turned = random_pose(np.random.default_rng(9), metres=1, degrees=90)
    seen = {a.shape: shared, b.shape: moved(turned, shared)}
    monkeypatch.setattr(paper, "detect_corners", lambda grid, *, preset: corners_at(seen[grid.shape]))
    found = register_paper(a, b)
    assert found.stats["clique_size"] == 7
    assert not found.accepted
    assert found.confidence < 0.5


def test_maps_without_corners_or_voxels_are_outcomes():
    flat = np.ones((20, 20, 8), np.uint8)
    flat[:, :, 0] = 2
    sheet = vx.VoxelGrid(flat, np.zeros(3, np.float32), VOXEL)
    empty = vx.VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3, np.float32), VOXEL)
    for a, b, result in (
        (sheet, sheet, vx.RESULTS.too_few_corners),
        (empty, sheet, vx.RESULTS.empty_map),
        (sheet, empty, vx.RESULTS.empty_map),
    ):
        found = register_paper(a, b)
        assert found.result == result
        assert found.verdict == "no_overlap"
        assert found.confidence == 0.0
        assert found.reason == vx.RESULTS[result] != ""
        assert set(found.stats) >= {"num_corners_a", "num_associations", "clique_size", "seconds"}
        np.testing.assert_array_equal(found.T_a_b, np.eye(4))
        assert np.isinf(np.asarray(found.covariance)).all()


def test_the_rule_of_the_verdict_is_a_setting(maps):
    found = register_paper(maps[0], maps[1], PaperConfig(min_matches=9999))
    assert found.verdict == "no_overlap"
    assert "9999" in found.reason
