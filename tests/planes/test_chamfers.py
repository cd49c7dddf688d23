import numpy as np

from voxjax.planes.chamfers import drop_chamfers
from voxjax.planes.surface import Surface, neighbour_pairs

UP = np.arange(20)


def walls_with_a_slanted_face(width):
    """Two walls at right angles whose edge is cut off by a face `width` diagonal steps wide."""
    along = np.arange(width + 1, width + 25)
    across = np.arange(1, width + 1)
    parts = (
        ([np.zeros_like(along), along], [1.0, 0.0, 0.0]),
        ([along, np.zeros_like(along)], [0.0, 1.0, 0.0]),
        ([across, width + 1 - across], [np.sqrt(0.5), np.sqrt(0.5), 0.0]),
    )
    index, normal, labels = [], [], []
    for label, ((x, y), n) in enumerate(parts):
        place = np.stack([np.repeat(x, len(UP)), np.repeat(y, len(UP)), np.tile(UP, len(x))], axis=1)
        index.append(place)
        normal.append(np.tile(np.asarray(n), (len(place), 1)))
        labels.append(np.full(len(place), label))
    index, normal, labels = (np.concatenate(p) for p in (index, normal, labels))
    order = np.lexsort(index.T[::-1])
    index = index[order].astype(np.int32)
    surface = Surface(
        index=index,
        normal=normal[order].astype(np.float32),
        curvature=np.zeros(len(index), np.float32),
        is_signed=np.ones(len(index), bool),
        pairs=neighbour_pairs(index),
    )
    return surface, labels[order].astype(np.int32)


def test_a_narrow_strip_across_an_edge_is_dropped():
    surface, labels = walls_with_a_slanted_face(3)
    kept = drop_chamfers(surface, labels, reach=4.0)
    assert (kept[labels == 2] == -1).all()
    np.testing.assert_array_equal(kept[labels < 2], labels[labels < 2])


def test_a_wide_slanted_face_is_kept():
    surface, labels = walls_with_a_slanted_face(9)
    np.testing.assert_array_equal(drop_chamfers(surface, labels, reach=4.0), labels)


def test_a_strip_between_parallel_faces_is_kept():
    surface, labels = walls_with_a_slanted_face(3)
    # Both walls turned to one direction: the strip is now the end of a wall, between its two sides.
    normal = np.where((labels == 1)[:, None], np.asarray([-1.0, 0.0, 0.0], np.float32), surface.normal)
    index = surface.index.copy()
    far = labels == 1
    index[far] = np.stack([np.full(far.sum(), 4), index[far, 0], index[far, 2]], axis=1)
    end = labels == 2
    index[end, 1], normal[end] = 4, [0.0, -1.0, 0.0]
    wall = Surface(
        index=index,
        normal=normal.astype(np.float32),
        curvature=surface.curvature,
        is_signed=surface.is_signed,
        pairs=surface.pairs,
    )
    np.testing.assert_array_equal(drop_chamfers(wall, labels, reach=4.0), labels)


def test_fewer_than_three_segments_have_no_chamfer():
    surface, labels = walls_with_a_slanted_face(3)
    two = np.where(labels == 2, -1, labels).astype(np.int32)
    np.testing.assert_array_equal(drop_chamfers(surface, two, reach=4.0), two)
