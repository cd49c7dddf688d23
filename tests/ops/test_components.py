"""Components and regions: SciPy's labels, breadth-first search, and laws."""

from collections import deque

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import voxjax as vx
from compilations import assert_compiles_nothing
from voxjax.ops.components import connected_components, grow_regions, label_voxels, padded_size
from voxjax.ops.surface.moments import surface_moments

IMPLEMENTATIONS = ("scipy", "compact")
CONNECTIVITIES = (6, 18, 26)


def by_search(occupied, connectivity, joins=lambda p, q: True):
    """Labels by breadth-first search, from the first voxel in C order on."""
    reach = {6: 1, 18: 2, 26: 3}[connectivity]
    steps = [s for s in np.ndindex(3, 3, 3) if 0 < sum(abs(c - 1) for c in s) <= reach]
    labels, count = np.zeros(occupied.shape, int), 0
    for start in map(tuple, np.argwhere(occupied)):
        if labels[start]:
            continue
        count += 1
        labels[start] = count
        queue = deque([start])
        while queue:
            at = queue.popleft()
            for step in steps:
                other = tuple(int(a + s - 1) for a, s in zip(at, step, strict=True))
                is_inside = all(0 <= c < n for c, n in zip(other, occupied.shape, strict=True))
                if is_inside and occupied[other] and not labels[other] and joins(at, other):
                    labels[other] = count
                    queue.append(other)
    return labels, count


def listed(occupied, num_padding=5):
    index = np.argwhere(occupied).astype(np.int32)
    mask = np.arange(len(index) + num_padding) < len(index)
    index = np.concatenate([index, np.zeros((num_padding, 3), np.int32)])
    return index, mask, np.asarray(occupied.shape, np.int32), padded_size(occupied.shape)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("implementation", IMPLEMENTATIONS)
@settings(max_examples=15, deadline=None)
@given(
    shape=st.sampled_from([(6, 5, 7), (1, 9, 40), (1, 1, 70), (8, 1, 1), (1, 1, 1)]),
    share=st.sampled_from([0.0, 0.1, 0.3, 0.6, 1.0]),
    seed=st.integers(0, 2**31),
)
def test_labels_are_those_of_a_search(connectivity, implementation, shape, share, seed):
    occupied = np.random.default_rng(seed).random(shape) < share
    labels, count = connected_components(occupied, connectivity=connectivity, implementation=implementation)
    expected, expected_count = by_search(occupied, connectivity)
    assert count == expected_count
    assert labels.dtype == np.int32
    np.testing.assert_array_equal(labels, expected)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
def test_a_long_snake_is_one_component_in_few_rounds(connectivity):
    snake = np.zeros((41, 41, 3), bool)
    snake[::2, :, 1] = True
    snake[1::4, -1, 1] = True
    snake[3::4, 0, 1] = True
    index, mask, dims, size = listed(snake)
    regions = label_voxels(index, mask, dims, flat_size=size, connectivity=connectivity)
    assert int(regions.num_regions) == 1
    assert int(regions.num_rounds) <= 10  # the way from end to end has 860 steps
    np.testing.assert_array_equal(regions.label, mask.astype(np.int32))


def test_both_implementations_agree_on_a_large_grid_and_number_as_scipy_does():
    occupied = np.random.default_rng(3).random((60, 50, 70)) < 0.08
    for rank, connectivity in enumerate(CONNECTIVITIES, start=1):
        expected = np.zeros(occupied.shape, np.int32)
        count = ndimage.label(occupied, ndimage.generate_binary_structure(3, rank), output=expected)
        for implementation in IMPLEMENTATIONS:
            labels, found = connected_components(
                occupied, connectivity=connectivity, implementation=implementation
            )
            assert found == count
            np.testing.assert_array_equal(labels, expected)


@pytest.mark.parametrize("connectivity", CONNECTIVITIES)
@pytest.mark.parametrize("is_signed", [True, False])
def test_regions_join_neighbours_of_like_normals(connectivity, is_signed):
    rng = np.random.default_rng(connectivity)
    occupied = rng.random((7, 8, 9)) < 0.4
    index, mask, dims, size = listed(occupied)
    normal = rng.normal(size=(len(index), 3)).astype(np.float32)
    normal[::7] = 0.0
    normal[1::2] = normal[0]  # large regions
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    row_of = {tuple(p): row for row, p in enumerate(index[mask].tolist())}

    def joins(p, q):
        cosine = float(normal[row_of[p]] @ normal[row_of[q]])
        return (cosine if is_signed else abs(cosine)) >= 0.6

    regions = grow_regions(
        index, mask, normal, dims, 0.6, flat_size=size, connectivity=connectivity, is_signed=is_signed
    )
    expected, count = by_search(occupied, connectivity, joins)
    assert int(regions.num_regions) == count
    np.testing.assert_array_equal(np.asarray(regions.label)[mask], expected[occupied])
    assert not np.asarray(regions.label)[~mask].any()


def test_masked_voxels_belong_to_no_region_and_join_nothing():
    occupied = np.zeros((5, 1, 9), bool)
    occupied[2] = True
    occupied[3, 0, 4] = True
    index, mask, dims, size = listed(occupied)
    normal = np.tile(np.asarray([0, 0, 1], np.float32), (len(index), 1))
    mask[4] = False  # the middle of the line; the voxel beside it still bridges the gap
    regions = grow_regions(index, mask, normal, dims, 0.9, flat_size=size)
    assert int(regions.num_regions) == 1
    np.testing.assert_array_equal(regions.label, mask.astype(np.int32))
    by_faces = grow_regions(index, mask, normal, dims, 0.9, flat_size=size, connectivity=6)
    np.testing.assert_array_equal(np.asarray(by_faces.label)[:10], [1, 1, 1, 1, 0, 2, 2, 2, 2, 3])


def test_the_faces_of_a_box_are_six_regions():
    box = np.zeros((26, 24, 22), np.uint8) + np.uint8(1)
    box[3:-3, 3:-3, 3:-3] = 2
    box[4:-4, 4:-4, 4:-4] = 0
    index, mask, dims, size = listed(box == 2)
    moments = surface_moments(box, index, size=5)
    is_flat = mask & (np.asarray(moments.curvature) < 0.01)
    regions = grow_regions(index, is_flat, moments.normal, dims, np.cos(np.radians(5)), flat_size=size)
    assert int(regions.num_regions) == 6


def test_padding_and_the_ladder_change_nothing_and_compile_nothing_new():
    occupied = np.random.default_rng(8).random((9, 10, 11)) < 0.2
    index, mask, dims, size = listed(occupied, num_padding=40)
    label_voxels(index, mask, dims, flat_size=size)
    turned = np.ascontiguousarray(np.transpose(occupied, (2, 0, 1)))
    other, other_mask, other_dims, _ = listed(turned, num_padding=40)
    with assert_compiles_nothing(label_voxels):
        regions = label_voxels(other, other_mask, other_dims, flat_size=size)
    _, count = connected_components(occupied)
    assert int(regions.num_regions) == count


def test_the_kernel_works_under_an_outer_jit_and_vmap():
    rng = np.random.default_rng(9)
    grids = rng.random((3, 6, 6, 6)) < 0.3
    lists = [listed(g, num_padding=216 - int(g.sum())) for g in grids]
    index, mask = (jnp.asarray(np.stack([part[k] for part in lists])) for k in (0, 1))
    dims, size = lists[0][2:]
    batch = jax.jit(jax.vmap(lambda i, m: label_voxels(i, m, dims, flat_size=size)))(index, mask)
    for k, grid in enumerate(grids):
        labels, count = connected_components(grid)
        assert int(batch.num_regions[k]) == count
        np.testing.assert_array_equal(np.asarray(batch.label[k])[lists[k][1]], labels[grid])


@pytest.mark.parametrize("implementation", [*IMPLEMENTATIONS, None])
def test_a_grid_without_voxels_has_no_components(implementation):
    labels, count = connected_components(np.zeros((3, 4, 5), bool), implementation=implementation)
    assert count == 0
    np.testing.assert_array_equal(labels, np.zeros((3, 4, 5)))


def test_what_is_unknown_is_refused():
    occupied = np.ones((2, 2, 2), bool)
    with pytest.raises(vx.InputError, match="connectivity"):
        connected_components(occupied, connectivity=8)
    with pytest.raises(vx.InputError, match="implementation"):
        connected_components(occupied, implementation="cc3d")
    index, mask, dims, size = listed(occupied)
    with pytest.raises(vx.InputError, match="connectivity"):
        label_voxels(index, mask, dims, flat_size=size, connectivity=4)
    with pytest.raises(vx.InputError, match="rows"):
        label_voxels(index[:0], mask[:0], dims, flat_size=size)


@pytest.mark.real_maps
def test_real_maps_settle_within_ten_rounds(maps_folder):
    for name in ("split_geb079/a.bt", "split_freiburg1_360/a.bt"):
        occupied = np.asarray(vx.read_map(maps_folder / "real" / name).states) == 2
        index, mask, dims, size = listed(occupied)
        for connectivity in CONNECTIVITIES:
            regions = label_voxels(index, mask, dims, flat_size=size, connectivity=connectivity)
            labels, count = connected_components(occupied, connectivity=connectivity, implementation="scipy")
            assert int(regions.num_rounds) <= 10
            assert int(regions.num_regions) == count
            np.testing.assert_array_equal(np.asarray(regions.label)[mask], labels[occupied])
