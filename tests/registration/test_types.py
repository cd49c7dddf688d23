"""What a registration says of itself."""

import numpy as np
import pytest

from fake_register import registration
from voxjax import RESULTS, Registration


@pytest.mark.parametrize(
    ("verdict", "is_accepted"), [("accepted", True), ("ambiguous", False), ("no_overlap", False)]
)
def test_only_an_accepted_pose_may_be_used(verdict, is_accepted):
    found = registration(np.eye(4), verdict=verdict, score=0.25)
    assert found.accepted == is_accepted
    assert found.best_score == 0.25


def test_without_a_hypothesis_the_score_is_below_everything():
    eye = np.eye(4, dtype=np.float32)
    none = Registration(
        eye, "no_overlap", 0.0, np.eye(6, dtype=np.float32), (), "Nothing.", RESULTS.no_overlap, {}
    )
    assert none.best_score == -np.inf
