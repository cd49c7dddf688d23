# pyright: reportCallIssue=false
"""The search on the host against the compiled one and against the definition."""

import numpy as np
import pytest

from oracles.evidence import shifted_score
from small_worlds import draw_map, pose
from voxjax.ops import correlate_host as host
from voxjax.registration.exhaustive import _place, upright_frame
from voxjax.registration.map_features import map_features
from voxjax.registration.translation_search import search_on_device, search_on_host

CELLS = (16, 24, 20)


def test_peaks_are_the_largest_two_way_scores():
    rng = np.random.default_rng(0)
    fields = rng.normal(size=(4, *CELLS)).astype(np.float32)
    spectra = [np.fft.rfftn(f).astype(np.complex64) for f in fields]
    top, shift = host.correlation_peaks(*spectra, cells=CELLS, num_peaks=5)
    assert (np.diff(top) <= 0).all()
    for score, t in zip(top, shift, strict=True):
        assert abs(score - shifted_score(*fields, t)) < 1e-2
    best = max(shifted_score(*fields, t) for t in np.ndindex(*CELLS))
    assert abs(top[0] - best) < 1e-2
    assert (np.abs(shift) <= np.asarray(CELLS) // 2).all()


@pytest.mark.parametrize("needed", [1, 4, 17, 33, 101, 255])
def test_blocks_hold_what_is_needed_in_whole_peak_blocks(needed):
    size = host.block_size(needed)
    assert needed <= size <= max(1.35 * needed, needed + 4)
    assert size % host.PEAK_BLOCK == 0


def test_host_and_device_find_the_same_best_translations():
    frame_b = pose(yaw=33.0, tilt=12.0, translation=(3.0, -2.0, 1.0))
    a, b = (map_features(draw_map(T), max_virtual=8) for T in (None, frame_b))
    rotations = np.linalg.inv(frame_b)[None, :3, :3] @ np.stack([np.eye(3), pose(yaw=90.0)[:3, :3]])
    corners = [np.asarray(m.prepared.points)[: m.prepared.num_points].astype(np.float64) for m in (a, b)]
    factor, places = _place(
        *corners, rotations, upright_frame(a.directions, a.shares), a.prepared.grid.voxel_size
    )
    results = [
        search(a.prepared, b.prepared, factor, places, 8) for search in (search_on_host, search_on_device)
    ]
    for (top, shift), (other_top, other_shift) in zip(*results, strict=True):
        # Blocks of other sizes group other peaks; the best one is the same.
        np.testing.assert_allclose(top[0], other_top[0], atol=2e-3)
        np.testing.assert_array_equal(shift[0], other_shift[0])
