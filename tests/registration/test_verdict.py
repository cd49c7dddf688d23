import numpy as np
import pytest

from voxjax.registration.leaders import Judgement
from voxjax.registration.verdict import decide, support

BOUNDS = {"min_support": 0.02, "max_conflict": 0.06, "max_rival": 0.7, "min_support_without_free_space": 0.3}


def judgement(*poses):
    """Poses as (hits, conflicts, eigenvalues of 3 * information)."""
    hits, conflicts, spectra = zip(*poses, strict=True)
    information = np.stack([np.diag(np.asarray(s, float)) / 3 for s in spectra])
    return Judgement(np.asarray(hits, float), np.asarray(conflicts, float), np.zeros(len(hits)), information)


@pytest.mark.parametrize(
    ("poses", "has_free_space", "expected"),
    [
        ([(0.5, 0.005, (0.3, 0.4, 0.5)), (0.04, 0.001, (0.0, 0.0, 0.1))], True, "accepted"),
        ([(0.2, 0.001, (0.0, 0.001, 0.6)), (0.19, 0.001, (0.0, 0.001, 0.6))], True, "no_overlap"),
        ([(0.5, 0.005, (0.3, 0.4, 0.5)), (0.45, 0.005, (0.3, 0.4, 0.5))], True, "ambiguous"),
        ([(0.4, 0.002, (0.015, 0.4, 0.5))], True, "ambiguous"),
        ([(0.4, 0.038, (0.3, 0.4, 0.5))], True, "ambiguous"),
        ([(0.4, 0.1, (0.3, 0.4, 0.5))], True, "no_overlap"),
        ([(0.5, 0.0, (0.2, 0.4, 0.5))], False, "ambiguous"),
        ([(0.9, 0.0, (0.6, 0.7, 0.8)), (0.5, 0.0, (0.3, 0.3, 0.3))], False, "accepted"),
    ],
)
def test_verdict_and_confidence_go_together(poses, has_free_space, expected):
    finding = decide(judgement(*poses), has_free_space=has_free_space, **BOUNDS)
    assert finding.verdict == expected
    assert 0.0 <= finding.confidence <= 1.0
    assert (finding.confidence > 0.5) == (expected == "accepted")
    assert finding.reason.endswith(".")


def test_no_pose_is_no_overlap():
    empty = Judgement(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros((0, 3, 3)))
    assert decide(empty, has_free_space=True, **BOUNDS).verdict == "no_overlap"


def test_full_agreement_has_support_one_and_conflicts_take_it_off():
    full = judgement((1.0, 0.0, (1, 1, 1)), (0.9, 0.1, (1, 1, 1)), (0.9, 0.5, (1, 1, 1)))
    np.testing.assert_allclose(support(full), [1.0, 0.4, 0.0])
