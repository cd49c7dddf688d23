"""Robots on their way."""

import numpy as np

from voxjax.synthetic.camera import DepthCamera
from voxjax.synthetic.families import make_place
from voxjax.synthetic.families.visitor import Survey, Visitor, walk

CAMERA = DepthCamera(num_pixels=(20, 16))
SURVEY = Survey(CAMERA, voxel_size=0.1, extent=0.6, drift=0.02)


def _visitor(seed):
    place = make_place("room", 1)
    return Visitor([seed], place, place.scene(np.random.default_rng(0)), SURVEY)


def test_scans_are_the_same_in_whatever_order_they_are_asked_for():
    first, second = _visitor(4), _visitor(4)
    forward = [first.scan(k).points for k in range(3)]
    backward = [second.scan(k).points for k in (2, 1, 0)][::-1]
    for a, b in zip(forward, backward, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(_visitor(5).scan(0).points, forward[0])


def test_maps_with_and_without_free_space_hold_the_cloud():
    visitor = _visitor(6)
    part = range(2, 2 + visitor.num_scans)
    # As many as lie on the extent of its survey, a tenth of a metre apart.
    assert visitor.num_scans == 1 + 6
    full, bare = (visitor.map(part, np.eye(4), has_free_space=known) for known in (True, False))
    assert full.num_free > 1000
    assert bare.num_free == 0
    index = bare.index_from_world(visitor.cloud(part))
    assert (bare.states_at(index) == 2).all()
    # Free space of later scans takes little away.
    assert 0.7 * bare.num_occupied < full.num_occupied <= bare.num_occupied


def test_ways_keep_clear_of_solids_and_cameras_look_to_one_side():
    place = make_place("room", 2)
    scene = place.scene(np.random.default_rng(0))
    poses = walk(np.random.default_rng(1), place, scene)
    assert scene.solids.distance(poses[:, :3, 3]).min() > 0.25
    # All look down by some, as people hold a camera.
    assert np.median(poses[:, 2, 0]) < -0.1
