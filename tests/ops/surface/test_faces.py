import numpy as np
import pytest

from oracles import box_room
from voxjax._runtime.tables import reserve, table_length
from voxjax.ops.surface.faces import OCTANT_SIGNS, _faces_kernel, corner_faces, edge_directions


def test_edges_lie_in_the_two_other_planes_on_the_positive_side():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(50, 3, 3)).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    edges = np.asarray(edge_directions(normals))
    product = np.einsum("mij,mkj->mik", edges, normals)
    off_diagonal = ~np.eye(3, dtype=bool)
    assert np.abs(product[:, off_diagonal]).max() < 1e-4
    assert (np.diagonal(product, axis1=1, axis2=2) > 0).all()


@pytest.mark.parametrize("turn", [np.eye(3), box_room.rotation((1, 2, -1), 0.8)], ids=["straight", "turned"])
def test_room_corner_is_seen_from_its_own_octant_only(turn):
    states, vector = box_room.room_map(turn)
    faces = corner_faces(states, vector[None].astype(np.float32), turn.T[None].astype(np.float32))
    seen, free = np.asarray(faces.seen)[0], np.asarray(faces.free)[0]
    own = int(np.flatnonzero((OCTANT_SIGNS == 1).all(axis=1))[0])
    assert seen[own].min() > 0.7
    assert free[own] == 1.0
    others = np.arange(8) != own
    assert seen[others].max() == 0.0
    assert free[others].max() == 0.0


def test_patches_are_shared_by_the_two_octants_beside_them():
    rng = np.random.default_rng(1)
    states = rng.integers(0, 3, (30, 30, 30)).astype(np.uint8)
    faces = corner_faces(states, np.full((1, 3), 15.0, np.float32), np.eye(3, dtype=np.float32)[None])
    occupied = np.asarray(faces.occupied)[0]
    for octant in range(8):
        for plane in range(3):
            assert occupied[octant, plane] == pytest.approx(occupied[octant ^ (1 << plane), plane])
    assert (np.asarray(faces.seen)[0] <= occupied + 1e-6).all()


def test_space_outside_the_map_is_unknown():
    states = np.full((4, 4, 4), 1, np.uint8)
    places = np.asarray([[50.0, 0, 0], [-50.0, 0, 0], [1e9, 1e9, -1e9]], np.float32)
    faces = corner_faces(states, places, np.stack([np.eye(3, dtype=np.float32)] * 3))
    assert not any(np.asarray(a).any() for a in faces)


def test_faces_are_seen_beyond_2_to_the_28_voxels():
    shape = (936, 1698, 174)
    flat = reserve(table_length(int(np.prod(shape))), dtype=np.uint8)
    block = flat[: int(np.prod(shape))].reshape(shape)
    small = np.ones((24, 24, 24), np.uint8)
    small[:, :, 23] = small[:, 23] = small[23] = 2
    block[-24:, -24:, -24:] = small
    position, normals = np.full((1, 3), 23, np.float32), -np.eye(3, dtype=np.float32)[None]
    expected = corner_faces(small, position, normals)
    far = position + np.asarray(shape, np.float32) - np.float32(24)
    box = np.zeros(3, np.int32), np.asarray(shape, np.int32)
    found = _faces_kernel(flat, box, far, normals, first=1.5, last=5.5)
    for one, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(one, np.asarray(other))
    assert np.asarray(found.seen).max() > 0.9
