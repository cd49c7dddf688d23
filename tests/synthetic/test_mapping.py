import numpy as np
import octomap
import pytest

from oracles.motions import pose_of
from voxjax._types import FREE, OCCUPIED
from voxjax.synthetic import Lidar
from voxjax.synthetic.lidar import Scan, take_scan
from voxjax.synthetic.mapping import build_map
from voxjax.synthetic.trajectory import walk_rooms

LIDAR = Lidar(range_noise=0.01)


VOXEL = 0.1


@pytest.fixture(scope="module")
def walk(storey):
    rng = np.random.default_rng(0)
    poses = walk_rooms(rng, storey, [0, 1])
    return [take_scan(rng, storey.scene, T, LIDAR) for T in poses], poses


def test_map_agrees_with_the_building(storey, walk):
    scans, poses = walk
    grid = build_map(scans, poses, voxel_size=VOXEL)
    distance = storey.solids.distance(grid.occupied_points().astype(np.float64))
    near = np.abs(distance).min(axis=1) < 2 * VOXEL
    assert near.mean() > 0.97  # the others are people
    free = grid.world_from_index(np.argwhere(np.asarray(grid.states) == FREE)).astype(np.float64)
    depth = storey.solids.distance(free).min(axis=1)
    assert (depth < -VOXEL).mean() < 2e-3
    # Seen from inside, the floors of the visited rooms are there.
    polygon = storey.plan.rooms[0].polygon
    middle = np.asarray([[*(0.7 * polygon[0] + 0.3 * polygon.mean(axis=0)), -0.05]], np.float32)
    index = grid.index_from_world(middle)[0]
    around = np.asarray(grid.states)[index[0] - 3 : index[0] + 4, index[1] - 3 : index[1] + 4]
    assert (around[:, :, max(index[2] - 1, 0) : index[2] + 2] == OCCUPIED).any(axis=2).mean() > 0.5


def test_states_follow_the_log_odds(walk):
    scans, poses = walk
    grid = build_map(scans, poses, voxel_size=0.2)
    odds, states = np.asarray(grid.log_odds), np.asarray(grid.states)
    assert np.array_equal(states == OCCUPIED, odds > 0)
    assert odds.min() >= -2.0
    assert odds.max() <= 3.5
    assert (odds[states == 0] == 0).all()


def test_hits_and_misses_add_up_and_stop_at_the_bounds():
    scan = Scan(np.asarray([[1.0, 0.01, 0.01], [1.0, 0.02, 0.02]]), 2)
    T = pose_of(translation=[0.05] * 3)
    for count, hit, miss in ((1, 0.85, -0.4), (3, 2.55, -1.2), (9, 3.5, -2.0)):
        grid = build_map([scan] * count, np.stack([T] * count), voxel_size=0.1)
        odds = np.asarray(grid.log_odds)[:, 0, 0]
        np.testing.assert_allclose(odds[:10], miss, atol=1e-5)
        np.testing.assert_allclose(odds[10], hit, atol=1e-5)
        assert grid.shape == (11, 1, 1)


def test_map_is_the_one_that_octomap_builds(walk):
    scans, poses = walk
    scans, poses = scans[:4], poses[:4]
    grid = build_map([Scan(s.points[: s.num_hits], s.num_hits) for s in scans], poses, voxel_size=VOXEL)
    tree = octomap.OcTree(VOXEL)
    tree.setProbHit(1 / (1 + np.exp(-0.85)))
    tree.setProbMiss(1 / (1 + np.exp(0.4)))
    tree.setClampingThresMin(1 / (1 + np.exp(2.0)))
    tree.setClampingThresMax(1 / (1 + np.exp(-3.5)))
    for scan, T in zip(scans, poses, strict=True):
        points = scan.points[: scan.num_hits] @ T[:3, :3].T + T[:3, 3]
        tree.insertPointCloud(points, T[:3, 3], lazy_eval=False, discretize=False)
    index = np.argwhere(np.asarray(grid.states) > 0)
    nodes = [tree.search(p) for p in grid.world_from_index(index).astype(np.float64)]
    known = np.asarray([_has_node(node) for node in nodes])
    assert known.mean() > 0.999
    odds = np.asarray([node.getLogOdds() for node, k in zip(nodes, known, strict=True) if k])
    ours = np.asarray(grid.log_odds)[tuple(index[known].T)]
    # One ray a voxel here and all rays there, so a voxel that rays only touch is now and then seen once less.
    assert (np.abs(odds - ours) < 1e-3).mean() > 0.95
    assert ((odds > 0) == (ours > 0)).mean() > 0.995


def _has_node(node):
    try:
        node.getLogOdds()
    except octomap.NullPointerException:
        return False
    return True
