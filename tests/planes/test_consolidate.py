"""Segments are split, merged, extended and dropped by what is flat."""

import numpy as np

from hand_made_surfaces import sheet, surface_of
from voxjax.planes.consolidate import drop_narrow, extend_segments, merge_segments, split_segments


def test_segments_that_are_not_flat_are_split():
    floor = sheet(14, 14)
    ramp = sheet(14, 14)
    ramp[:, 0] += 14
    ramp[:, 2] = np.round(0.5 * (ramp[:, 0] - 13))
    tilted = np.asarray([-0.447, 0, 0.894])
    normal = np.concatenate([np.tile([0, 0, 1.0], (196, 1)), np.tile(tilted, (196, 1))])
    index = np.concatenate([floor, ramp])
    order = np.lexsort(index.T[::-1])
    surface = surface_of(index[order], normal[order], np.zeros(392))
    one = np.zeros(392, np.int32)
    labels = split_segments(surface, one, max_rms=0.7, distance=1.0, max_angle=20.0, min_elements=12)
    is_ramp = order >= 196
    assert {labels[is_ramp].max(), labels[~is_ramp].max()} == {0, 1}
    assert (labels[is_ramp] == labels[is_ramp].max()).mean() > 0.95


def test_pieces_of_one_plane_are_merged_and_others_are_not():
    index = np.concatenate([sheet(10, 10), sheet(10, 10) + [14, 0, 0], sheet(10, 10) + [28, 0, 4]])
    order = np.lexsort(index.T[::-1])
    labels = np.repeat(np.arange(3, dtype=np.int32), 100)[order]
    surface = surface_of(index[order], np.tile([0, 0, 1.0], (300, 1)), np.zeros(300))
    merged = merge_segments(surface, labels, max_rms=0.8, max_angle=6.0, gap=10.0)
    assert len(np.unique(merged[labels != 2])) == 1
    assert len(np.unique(merged)) == 2
    apart = merge_segments(surface, labels, max_rms=0.8, max_angle=6.0, gap=1.0)
    assert len(np.unique(apart)) == 3


def test_planes_grow_to_their_edges_but_not_onto_other_surfaces():
    index = np.concatenate([sheet(12, 12), sheet(12, 12, z=2)])
    order = np.lexsort(index.T[::-1])
    index = index[order]
    surface = surface_of(index, np.tile([0, 0, 1.0], (288, 1)), np.zeros(288))
    core = np.where((index[:, 2] == 0) & (np.abs(index[:, :2] - 5.5).max(axis=1) < 4), 0, -1).astype(np.int32)
    labels = extend_segments(surface, core, distance=1.2)
    np.testing.assert_array_equal(labels == 0, index[:, 2] == 0)


def test_narrow_strips_are_no_faces():
    strip, face = sheet(40, 2), sheet(10, 8) + [0, 10, 0]
    index = np.concatenate([strip, face])
    surface = surface_of(index, np.tile([0, 0, 1.0], (160, 1)), np.zeros(160))
    labels = np.repeat(np.asarray([0, 1], np.int32), 80)
    np.testing.assert_array_equal(drop_narrow(surface, labels, min_width=3.5), np.repeat([-1, 0], 80))
