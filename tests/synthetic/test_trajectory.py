import numpy as np
import pytest

from voxjax.synthetic import make_building
from voxjax.synthetic.trajectory import choose_rooms, draw_drift, pose_of, walk_rooms


@pytest.fixture(scope="module")
def building():
    return make_building(3)


@pytest.mark.parametrize("overlap", [0.0, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("num_robots", [1, 2, 4])
def test_rooms_are_shared_as_asked_and_all_are_visited(building, overlap, num_robots):
    rooms, shared = choose_rooms(np.random.default_rng(0), building, num_robots=num_robots, overlap=overlap)
    assert len(shared) == max(int(np.ceil(overlap * building.num_rooms)), 1)
    assert set.intersection(*map(set, rooms)) >= set(shared)
    assert set.union(*map(set, rooms)) == set(range(building.num_rooms))
    for robot in rooms:
        own = set(robot)
        reached, front = {robot[0]}, [robot[0]]
        while front:
            new = (set(building.neighbours(front.pop())) & own) - reached
            reached |= new
            front += new
        assert reached == own


def test_way_stays_clear_of_solids_and_enters_every_room(building):
    rooms, _ = choose_rooms(np.random.default_rng(1), building, num_robots=2, overlap=0.3)
    poses = walk_rooms(np.random.default_rng(2), building, rooms[0])
    places = poses[:, :3, 3]
    assert building.solids.distance(places).min() > 0.25
    for room in rooms[0]:
        polygon = building.plan.rooms[room].polygon
        along = np.roll(polygon, -1, axis=0) - polygon
        inward = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        inside = (np.einsum("sk,psk->ps", inward, places[:, None, :2] - polygon) > 0).all(axis=1)
        assert inside.any()


def test_poses_are_rigid(building):
    poses = walk_rooms(np.random.default_rng(2), building, [0])
    identity = np.eye(3)[None].repeat(len(poses), axis=0)
    rotations = poses[:, :3, :3]
    np.testing.assert_allclose(rotations @ np.swapaxes(rotations, 1, 2), identity, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(poses), 1.0, atol=1e-12)
    turned = pose_of(np.zeros(3), [0.0, 0.0, np.pi / 2])[:3, :3]
    np.testing.assert_allclose(turned @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)


def test_drift_is_smooth_and_as_large_as_asked():
    poses = np.eye(4)[None].repeat(400, 0)
    poses[:, 0, 3] = np.arange(400) * 0.5
    errors = np.concatenate(
        [
            draw_drift(np.random.default_rng(seed), poses, 0.05)[:, :3, 3] - poses[:, :3, 3]
            for seed in range(20)
        ]
    )
    np.testing.assert_allclose(errors[:, :2].std(), 0.05, rtol=0.15)
    assert np.abs(np.diff(errors[:400], axis=0)).max() < 0.05
    assert np.array_equal(draw_drift(np.random.default_rng(0), poses, 0.0), poses)
