"""Starts of the benchmark of refinement: exactly as far off as asked, the same each time; its generated pairs."""

import numpy as np
import pytest
from bench.refinement_cases import generated_cases, pose_off, starts_of
from refinement_rows import made_case, made_pair

from oracles import motions


@pytest.mark.parametrize(("metres", "degrees"), [(0.3, 3.0), (0.0, 30.0), (2.0, 0.0), (0.0, 0.0)])
def test_a_start_is_off_by_exactly_what_is_asked(metres, degrees):
    pair = made_pair()
    centroid = pair.centroid_of_b
    for start in starts_of(made_case(pair), pair, 5, metres=metres, degrees=degrees, seed=1):
        found_degrees, found_metres = motions.pose_error(start, pair.T_a_b, centroid)
        assert found_metres == pytest.approx(metres, abs=1e-9)
        assert found_degrees == pytest.approx(degrees, abs=1e-6)
        np.testing.assert_allclose(start[:3, :3] @ start[:3, :3].T, np.eye(3), atol=1e-12)


def test_starts_repeat_and_differ_with_number_seed_and_case():
    pair = made_pair()

    def starts(name, seed):
        return np.stack(starts_of(made_case(pair, name), pair, 2, metres=0.3, degrees=3.0, seed=seed))

    found = starts("x", 1)
    np.testing.assert_array_equal(found, starts("x", 1))
    others = [found[0], found[1], starts("x", 2)[0], starts("y", 1)[0]]
    assert len({other.tobytes() for other in others}) == 4


def test_starts_of_other_sizes_point_the_same_way():
    pair = made_pair()
    centroid = pair.centroid_of_b
    assert pair.T_a_b is not None
    near, far = (
        pose_off(pair.T_a_b, centroid, metres=m, degrees=0.0, rng=np.random.default_rng(4))
        for m in (0.5, 2.0)
    )
    np.testing.assert_allclose(4 * (near - pair.T_a_b)[:3, 3], (far - pair.T_a_b)[:3, 3], atol=1e-9)


def test_suites_share_their_worlds_and_meet_every_frame_and_voxel_size():
    free, drifting = (generated_cases(suite, 9, 5) for suite in ("drift-free", "drifting"))
    assert [c.name.split("/")[1] for c in free] == [c.name.split("/")[1] for c in drifting]
    assert {(c.frame, c.name.split("_")[-1]) for c in free} == {
        (frame, size) for frame in ("yaw", "tilt", "so3") for size in ("0.1", "0.2")
    }
