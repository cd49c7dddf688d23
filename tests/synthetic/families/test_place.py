"""Places: days, boxes, ways."""

from itertools import pairwise

import numpy as np

from voxjax.synthetic.camera import DepthCamera
from voxjax.synthetic.families.place import Place, box, moved, resampled, serpentine


def _place(count):
    pieces = [
        (
            [box((0.0 + k, 0.0), (0.5, 0.5), (0.0, 1.0), "old")],
            [box((0.0 + k, 0.0), (0.5, 0.5), (0.0, 2.0), "new")],
        )
        for k in range(count)
    ]
    wall = box((0.0, 5.0), (9.0, 0.2), (0.0, 3.0), "wall")
    return Place([wall], pieces, np.zeros((2, 3)), DepthCamera(), 0.1, (1.0, 2.0), 0.5, 0.1)


def test_a_share_of_the_pieces_is_replaced_and_what_is_fixed_stays():
    place, rng = _place(400), np.random.default_rng(0)
    for share in (0.0, 0.3, 1.0):
        kinds = list(place.scene(rng, share).solids.kind)
        assert kinds[0] == "wall"
        assert len(kinds) == 401
        np.testing.assert_allclose(kinds.count("new") / 400, share, atol=0.08)


def test_boxes_are_turned_and_shifted():
    footprint, low, high, kind = moved(
        [box((1.0, 0.0), (2.0, 1.0), (0.0, 1.0), "box")], np.asarray([0.0, 0.0, 3.0]), 0.5 * np.pi
    )[0]
    np.testing.assert_allclose(footprint.min(axis=0), (-0.5, 0.0), atol=1e-12)
    np.testing.assert_allclose(footprint.max(axis=0), (0.5, 2.0), atol=1e-12)
    assert (low, high, kind) == (3.0, 4.0, "box")


def test_places_on_a_line_lie_one_step_apart():
    line = np.asarray([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])
    places = resampled(line, 0.5)
    assert len(places) == 14
    np.testing.assert_allclose([np.linalg.norm(b - a) for a, b in pairwise(places)], 0.5)


def test_a_serpentine_comes_back_on_every_second_row():
    corners = serpentine([0.0, 2.0, 5.0], (1.0, 9.0))
    np.testing.assert_array_equal(corners, [(1, 0), (9, 0), (9, 2), (1, 2), (1, 5), (9, 5)])
