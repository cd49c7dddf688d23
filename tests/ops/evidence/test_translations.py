# pyright: reportCallIssue=false
"""The search of all translations: both forms find the same best ones."""

import numpy as np
from scipy.spatial.transform import Rotation

from device_path import device_path
from small_worlds import draw_map, pose
from voxjax.ops.evidence.translations import search_translations
from voxjax.registration.hypotheses.exhaustive import (
    _coarse_map,
    _place,
    _quarter_turns_apart,
    exhaustive_hypotheses,
    upright_frame,
)
from voxjax.registration.hypotheses.map_features import map_features

QUARTER_TURNS = Rotation.create_group("O").as_matrix()


def test_host_and_device_find_the_same_best_translations():
    frame_b = pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))
    a, b = (map_features(draw_map(T), max_virtual=8) for T in (None, frame_b))
    # Families of quarter turns share transforms on the host only; one more rotation stands alone.
    rotations = np.concatenate([QUARTER_TURNS, pose(yaw=20.0)[None, :3, :3]]) @ frame_b[:3, :3].T
    corners = [np.asarray(m.prepared.points)[: m.prepared.num_points].astype(np.float64) for m in (a, b)]
    frame = upright_frame(a.directions, a.shares)
    # The frame is an estimate, good to a milliradian, so that families are not quite quarter turns apart.
    places = _place(*corners, _quarter_turns_apart(frame @ rotations, 5e-3), frame, 0.45)
    assert len({place.upright_b.tobytes() for place in places}) <= 12
    maps = [_coarse_map(m.prepared, 3) for m in (a, b)]
    results = [search_translations(*maps, places, num_peaks=8, conflict_weight=3.0)]
    with device_path():
        results.append(search_translations(*maps, places, num_peaks=8, conflict_weight=3.0))
    num_clear = 0
    for (top, shift), (other_top, other_shift) in zip(*results, strict=True):
        # Blocks of other sizes group other peaks; the best one is the same.
        np.testing.assert_allclose(top[0], other_top[0], atol=2e-3)
        if other_top[0] - other_top[1] > 4e-3:
            num_clear += 1
            np.testing.assert_array_equal(shift[0], other_shift[0])
    assert num_clear >= 12
    best = int(np.argmax([top[0] for top, _ in results[0]]))
    np.testing.assert_allclose(rotations[best], frame_b[:3, :3].T, atol=1e-6)


def test_a_small_map_is_found_at_the_far_end_of_a_large_one():
    whole = draw_map()
    part = draw_map(seen=((-1.0, 6.6, -1.0), (3.5, 9.0, 3.0)))
    for a, b in ((whole, part), (part, whole)):
        maps = [map_features(m, max_virtual=8) for m in (a, b)]
        frame = upright_frame(maps[0].directions, maps[0].shares)
        poses, _ = exhaustive_hypotheses(
            maps[0].prepared, maps[1].prepared, np.eye(3)[None], frame, conflict_weight=3.0, num_peaks=1
        )
        np.testing.assert_allclose(poses[0, :3, 3], 0.0, atol=0.3)


def test_quarter_turns_are_made_exact_within_the_angle():
    head = pose(yaw=17.0, tilt=5.0)[:3, :3]
    rotations = np.stack(
        [head, pose(yaw=90.3)[:3, :3] @ head, pose(yaw=-92.0)[:3, :3] @ head, pose(yaw=45.0)[:3, :3] @ head]
    )
    snapped = _quarter_turns_apart(rotations, np.radians(0.5))
    np.testing.assert_allclose(snapped[1] @ head.T, pose(yaw=90.0)[:3, :3], atol=1e-12)
    np.testing.assert_array_equal(snapped[[0, 2, 3]], rotations[[0, 2, 3]])
