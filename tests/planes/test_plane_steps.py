"""Neighbours, region growing, consolidation, fits, rejection and intersections of planes."""

import equinox as eqx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracles import box_room, surfaces
from voxjax import VoxelGrid
from voxjax.planes.consolidate import drop_narrow, extend_segments, merge_segments, split_segments
from voxjax.planes.extract import extract_planes
from voxjax.planes.fit import fit_planes
from voxjax.planes.grow import keep_large, segment_planes
from voxjax.planes.reject import reject_corners
from voxjax.planes.surface import Surface, find_surface, neighbour_pairs
from voxjax.planes.triples import intersect_planes

SIZE = 0.1


def _grid(turn, **options):
    states, vector = box_room.room_map(turn, **options)
    return VoxelGrid(states, np.zeros(3, np.float32), SIZE), (vector + 0.5) * SIZE


def _surface(index, normal, curvature):
    """A surface made by hand; normals all signed."""
    n = len(index)
    return Surface(
        index=index.astype(np.int32), normal=normal.astype(np.float32), curvature=curvature.astype(np.float32),
        is_signed=np.ones(n, bool), pairs=neighbour_pairs(index.astype(np.int32)),
    )  # fmt: skip


def _sheet(nx, ny, z=0):
    return np.stack(
        [*(a.ravel() for a in np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij")), np.full(nx * ny, z)],
        1,
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 0.9))
def test_pairs_are_all_voxels_that_touch(seed, share):
    index = np.argwhere(np.random.default_rng(seed).random((5, 4, 6)) < share).astype(np.int32)
    ours = {tuple(pair) for pair in neighbour_pairs(index).tolist()}
    gap = np.abs(index[:, None] - index[None]).max(axis=2) if len(index) else np.zeros((0, 0))
    assert ours == {(i, j) for i, j in np.argwhere(gap == 1).tolist() if i < j}


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31))
def test_regions_equal_those_of_the_sequential_loop(seed):
    rng = np.random.default_rng(seed)
    index = np.argwhere(rng.random((7, 7, 3)) < 0.6)
    normal = rng.normal(size=(len(index), 3)) * 0.25 + [0, 0, 1.0]
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    curvature = rng.uniform(0, 0.12, len(index)).astype(np.float32)
    surface = _surface(index, normal, curvature)
    neighbours = [[] for _ in index]
    for i, j in surface.pairs.tolist():
        neighbours[i].append(j)
        neighbours[j].append(i)
    expected = surfaces.grow_regions(neighbours, surface.normal, surface.curvature, 15.0, 0.08)
    np.testing.assert_array_equal(segment_planes(surface, max_angle=15.0, max_curvature=0.08), expected)


def test_small_regions_lose_their_label():
    labels = np.asarray([0, 0, 1, 2, 2, 2, -1], np.int32)
    np.testing.assert_array_equal(keep_large(labels, 2), [0, 0, -1, 1, 1, 1, -1])
    np.testing.assert_array_equal(keep_large(labels, 9), np.full(7, -1))


def test_a_wall_seen_from_both_sides_has_two_faces():
    states = np.ones((14, 14, 9), np.uint8)
    states[:, :, 4] = 2
    surface = find_surface(VoxelGrid(states, np.zeros(3), SIZE))
    assert len(surface.index) == 2 * 14 * 14
    assert np.isclose(surface.normal[:, 2].sum(), 0.0, atol=1e-3)
    labels = segment_planes(surface)
    assert labels.max() == 1
    assert all(len({*np.sign(surface.normal[labels == k, 2])}) == 1 for k in (0, 1))


def test_segments_that_are_not_flat_are_split():
    floor = _sheet(14, 14)
    ramp = _sheet(14, 14)
    ramp[:, 0] += 14
    ramp[:, 2] = np.round(0.5 * (ramp[:, 0] - 13))
    tilted = np.asarray([-0.447, 0, 0.894])
    normal = np.concatenate([np.tile([0, 0, 1.0], (196, 1)), np.tile(tilted, (196, 1))])
    index = np.concatenate([floor, ramp])
    order = np.lexsort(index.T[::-1])
    surface = _surface(index[order], normal[order], np.zeros(392))
    one = np.zeros(392, np.int32)
    labels = split_segments(surface, one, max_rms=0.7, distance=1.0, max_angle=20.0, min_elements=12)
    is_ramp = order >= 196
    assert {labels[is_ramp].max(), labels[~is_ramp].max()} == {0, 1}
    assert (labels[is_ramp] == labels[is_ramp].max()).mean() > 0.95


def test_pieces_of_one_plane_are_merged_and_others_are_not():
    index = np.concatenate([_sheet(10, 10), _sheet(10, 10) + [14, 0, 0], _sheet(10, 10) + [28, 0, 4]])
    order = np.lexsort(index.T[::-1])
    labels = np.repeat(np.arange(3, dtype=np.int32), 100)[order]
    surface = _surface(index[order], np.tile([0, 0, 1.0], (300, 1)), np.zeros(300))
    merged = merge_segments(surface, labels, max_rms=0.8, max_angle=6.0, gap=10.0)
    assert len(np.unique(merged[labels != 2])) == 1
    assert len(np.unique(merged)) == 2
    apart = merge_segments(surface, labels, max_rms=0.8, max_angle=6.0, gap=1.0)
    assert len(np.unique(apart)) == 3


def test_planes_grow_to_their_edges_but_not_onto_other_surfaces():
    index = np.concatenate([_sheet(12, 12), _sheet(12, 12, z=2)])
    order = np.lexsort(index.T[::-1])
    index = index[order]
    surface = _surface(index, np.tile([0, 0, 1.0], (288, 1)), np.zeros(288))
    core = np.where((index[:, 2] == 0) & (np.abs(index[:, :2] - 5.5).max(axis=1) < 4), 0, -1).astype(np.int32)
    labels = extend_segments(surface, core, distance=1.2)
    np.testing.assert_array_equal(labels == 0, index[:, 2] == 0)


def test_narrow_strips_are_no_faces():
    strip, face = _sheet(40, 2), _sheet(10, 8) + [0, 10, 0]
    index = np.concatenate([strip, face])
    surface = _surface(index, np.tile([0, 0, 1.0], (160, 1)), np.zeros(160))
    labels = np.repeat(np.asarray([0, 1], np.int32), 80)
    np.testing.assert_array_equal(drop_narrow(surface, labels, min_width=3.5), np.repeat([-1, 0], 80))


def _clouds(seed, num, offset=0.0):
    rng = np.random.default_rng(seed)
    points, labels, truth = [], [], []
    for k in range(num):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        flat = rng.uniform(-1, 1, (120, 3))
        points.append(
            flat - np.outer(flat @ n, n) + 0.01 * rng.normal(size=(120, 1)) * n + rng.normal(size=3) + offset
        )
        labels.append(np.full(120, k))
        truth.append(n)
    return np.concatenate(points), np.concatenate(labels).astype(np.int32), np.asarray(truth)


@pytest.mark.parametrize("offset", [0.0, 300.0])
def test_least_squares_planes_equal_svd_also_far_from_the_origin(offset):
    points, labels, truth = _clouds(0, 5, offset)
    planes = fit_planes(points, labels, normals=truth[labels]).trimmed()
    assert int(planes.num_found) == 5
    for k in range(5):
        own = points[labels == k]
        normal, centroid = surfaces.plane_by_svd(own)
        assert abs(planes.normal[k] @ normal) > 1 - 1e-5
        assert planes.normal[k] @ truth[k] > 0
        assert planes.normal[k] @ centroid == pytest.approx(planes.offset[k], abs=2e-3 if offset else 1e-4)
        assert planes.num_voxels[k] == 120
        assert planes.rms[k] == pytest.approx(np.sqrt(np.mean(((own - centroid) @ normal) ** 2)), rel=0.05)


def test_huber_loss_holds_against_outliers():
    points, labels, truth = _clouds(1, 3)
    rng = np.random.default_rng(2)
    bad = rng.random(len(points)) < 0.15
    points[bad] += truth[labels[bad]] * rng.uniform(0.2, 0.6, (bad.sum(), 1))

    def worst(**options):
        planes = fit_planes(points, labels, normals=truth[labels], **options).trimmed()
        return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", planes.normal, truth), -1, 1))).max()

    assert worst(huber_scale=0.02, num_rounds=8) < 1.0 < worst()


def test_no_segments_no_planes():
    planes = fit_planes(np.zeros((0, 3)), np.zeros(0, np.int32))
    assert int(planes.num_found) == 0
    assert not np.asarray(planes.mask).any()
    unlabelled = fit_planes(np.ones((5, 3)), np.full(5, -1, np.int32))
    assert int(unlabelled.num_found) == 0


def test_rejection_is_equation_three():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(6, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    offsets = rng.normal(size=6).astype(np.float32) * 0.3
    points = rng.normal(size=(40, 3)).astype(np.float32) * 0.5
    # All planes are beside all points: one support point of each within the radius.
    support, labels = np.zeros((6, 3), np.float32), np.arange(6, dtype=np.int32)
    keep, rows, worst = reject_corners(
        points,
        normals,
        offsets,
        support,
        labels,
        max_distance=0.3,
        support_radius=50.0,
        min_triple_product=0.3,
    )
    expected = [surfaces.nearest_three(p, normals, offsets, 0.3) for p in points]
    np.testing.assert_allclose(worst, expected, atol=1e-4)
    np.testing.assert_array_equal(keep, np.asarray(expected) < 0.3)
    assert 0 < keep.sum() < 40
    product = np.linalg.det(normals[rows[keep]].astype(np.float64))
    assert (np.abs(product) >= 0.3).all()
    assert (rows[~keep] == -1).all()


def test_planes_without_voxels_beside_a_corner_do_not_count():
    normals, offsets = np.eye(3, dtype=np.float32), np.zeros(3, np.float32)
    point = np.zeros((1, 3), np.float32)
    labels = np.arange(3, dtype=np.int32)
    near = np.full((3, 3), 0.1, np.float32)
    far = near.copy()
    far[2] = 9.0
    for support, expected in ((near, True), (far, False)):
        keep = reject_corners(point, normals, offsets, support, labels, max_distance=0.1, support_radius=1.0)[
            0
        ]
        assert keep.tolist() == [expected]


@pytest.mark.parametrize("turn", [np.eye(3), box_room.rotation((1, 2, 3), 0.7)], ids=["straight", "turned"])
def test_planes_of_a_room_are_good_to_six_tenths_of_a_degree(turn):
    grid, shift = _grid(turn, noise=0.2)
    found = extract_planes(grid)
    planes = found.planes.trimmed()
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = turn[:, axis] * sign
            place = shift + (turn @ box_room.ROOM * SIZE if sign < 0 else 0.0)
            row = np.argmin(
                np.linalg.norm(planes.normal - normal, axis=1) + np.abs(planes.offset - normal @ place)
            )
            assert np.degrees(np.arccos(min(planes.normal[row] @ normal, 1.0))) < 0.6
            assert planes.offset[row] == pytest.approx(normal @ place, abs=0.25 * SIZE)
    assert (np.diff(planes.num_voxels) <= 0).all()
    counts = np.bincount(found.labels[found.labels >= 0], minlength=len(planes.num_voxels))
    np.testing.assert_array_equal(counts, planes.num_voxels)


def test_intersections_lie_on_their_planes_and_near_their_support():
    grid, _ = _grid(box_room.rotation((0, 0, 1), 0.3))
    found = extract_planes(grid)
    triples = intersect_planes(found, reach=0.6, min_triple_product=0.4)
    normal, offset = np.asarray(found.planes.normal), np.asarray(found.planes.offset)
    assert len(triples.planes) >= 16
    gap = np.einsum("mij,mj->mi", normal[triples.planes], triples.position) - offset[triples.planes]
    assert np.abs(gap).max() < 1e-4
    for row in range(0, len(triples.planes), 5):
        for column in range(3):
            support = found.points[found.labels == triples.planes[row, column]]
            nearest = np.linalg.norm(support - triples.position[row], axis=1).min()
            # Support is thinned to one element in four voxels.
            assert nearest - 1e-5 <= triples.distance[row, column] <= nearest + 4 * SIZE * 3**0.5
    product = np.linalg.det(normal[triples.planes].astype(np.float64))
    np.testing.assert_allclose(triples.triple_product, product, atol=1e-5)


def test_empty_maps_have_no_planes():
    found = extract_planes(VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3), SIZE))
    assert int(found.planes.num_found) == 0
    assert len(found.labels) == 0
    assert len(intersect_planes(found, reach=1.0, min_triple_product=0.4).planes) == 0
    assert eqx.tree_equal(found, found)
