"""The plain rule by which the paper's poses are accepted."""

import re

import numpy as np
import pytest

from small_worlds import draw_map, pose
from voxjax.registration.paper.settings import PaperConfig
from voxjax.registration.paper.verdict import judge_schemes

SETTINGS = PaperConfig()


@pytest.fixture(scope="module")
def grid():
    return draw_map()


@pytest.mark.parametrize(
    ("poses", "counts", "size", "expected"),
    [
        ([pose()], [900], 12, "accepted"),
        ([pose()], [900], 5, "no_overlap"),
        ([pose(translation=(0.9, 0.0, 0.0))], [300], 12, "no_overlap"),
        ([pose(), pose(yaw=90.0)], [900, 100], 12, "accepted"),
        ([pose(), pose(yaw=90.0)], [900, 800], 12, "ambiguous"),
        ([pose(), pose(yaw=1.0)], [900, 899], 12, "accepted"),
    ],
)
def test_matches_evidence_and_rivals_elsewhere_decide(grid, poses, counts, size, expected):
    found = judge_schemes(
        grid,
        grid,
        np.stack(poses).astype(np.float32),
        np.asarray(counts),
        size=size,
        settings=SETTINGS,
        conflict_weight=6.0,
    )
    assert found.verdict == expected
    assert len(found.hypotheses) == len(poses)
    assert (found.confidence > 0.4) == (expected == "accepted")
    assert f"{size} corners match" in found.reason or expected == "ambiguous"


def test_conflicts_count_by_their_weight(grid):
    wrong = pose(translation=(0.9, 0.0, 0.0))[None].astype(np.float32)
    scores = [
        judge_schemes(
            grid, grid, wrong, np.asarray([1]), size=9, settings=SETTINGS, conflict_weight=weight
        ).hypotheses[0]
        for weight in (0.0, 6.0)
    ]
    assert scores[0].score > 0.0 > scores[1].score
    assert scores[0].evidence.num_hits == scores[1].evidence.num_hits


@pytest.mark.parametrize(
    ("counts", "size", "expected"),
    [
        (
            [900, 100],
            12,
            r"The largest scheme is supported: 12 corners match and the evidence of all voxels is 1\.00\.",
        ),
        (
            [900, 100],
            5,
            r"Too little speaks for the best pose: 5 corners match and the evidence of all voxels is 1\.00 "
            r"\(\d+ and 0\.\d+ are needed\)\.",
        ),
        (
            [900, 810],
            12,
            r"Another scheme of equal size fuses 90 % as many voxels: 12 corners match and the evidence of all voxels "
            r"is 1\.00\.",
        ),
    ],
)
def test_reasons_have_the_figures_that_decided(grid, counts, size, expected):
    poses = np.stack([pose(), pose(yaw=90.0)]).astype(np.float32)
    options = {"size": size, "settings": SETTINGS, "conflict_weight": 6.0}
    assert re.fullmatch(expected, judge_schemes(grid, grid, poses, np.asarray(counts), **options).reason)
