"""What sensors meet: solids that are near enough, ground, and how both are bent."""

import numpy as np

from oracles.motions import pose_of
from voxjax.synthetic import Lidar
from voxjax.synthetic.ground import Ground
from voxjax.synthetic.lidar import take_scan
from voxjax.synthetic.prisms import make_prisms, rectangle
from voxjax.synthetic.scene import Scene, measure_ranges
from voxjax.synthetic.warp import draw_warp


def _posts(count, reach):
    rng = np.random.default_rng(5)
    places = rng.uniform(-reach, reach, (count, 2))
    return make_prisms([(rectangle(at, 0.6, 0.4, 0.3), -1.0, 2.0, "post") for at in places])


def test_solids_beyond_the_longest_range_change_nothing_below_it(storey):
    origin = np.asarray([*storey.plan.rooms[0].polygon.mean(axis=0), 1.3])
    directions = Lidar(num_azimuths=60).directions()
    full, near = (
        measure_ranges(storey.solids, origin, directions),
        storey.scene.ranges(origin, directions, 4.0),
    )
    is_near = full <= 4.0
    np.testing.assert_array_equal(near[is_near], full[is_near])
    assert (near[~is_near] > 4.0).all()
    assert len(storey.solids.within(origin, 2.0).kind) < len(storey.solids.kind)


def test_the_nearer_of_ground_and_solids_is_met():
    ground = Ground(np.random.default_rng(0), 60.0, 0.5)
    posts = _posts(60, 10.0)
    posts = posts._replace(footprint=posts.footprint + 30.0)
    origin = np.asarray([30.0, 30.0, 3.0])
    directions = Lidar(num_azimuths=90).directions()
    both = Scene(posts, ground).ranges(origin, directions, 15.0)
    alone = ground.ranges(origin, directions, 15.0), measure_ranges(posts, origin, directions)
    np.testing.assert_array_equal(both[both <= 15.0], np.minimum(*alone)[both <= 15.0])
    assert (alone[1] < alone[0]).sum() > 20


def test_a_bent_wall_is_bent_alike_for_all_who_look_at_it():
    wall = make_prisms([(rectangle(np.asarray([6.0, 0.0]), 1.0, 40.0, 0.0), -5.0, 5.0, "wall")])
    warp = draw_warp(np.random.default_rng(1), 0.15, (2.0, 8.0))
    still = Lidar(range_noise=0.0, dropout=0.0, people=0.0, num_azimuths=90)
    for shift in ((0.0, 0.0, 0.0), (1.0, 3.0, 0.5)):
        T = pose_of(translation=shift)
        scans = [take_scan(np.random.default_rng(0), Scene(wall, warp=how), T, still) for how in (None, warp)]
        straight, bent = (scan.points[: scan.num_hits] + T[:3, 3] for scan in scans)
        np.testing.assert_allclose(bent, straight + warp(straight), atol=1e-9)
        assert np.abs(bent[:, 0] - 5.5).max() > 0.1
