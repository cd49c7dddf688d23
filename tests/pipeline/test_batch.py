"""Many pairs at once, and the same bits in another process."""

import hashlib
import subprocess
import sys

import numpy as np
import pytest

import voxjax as vx
from small_worlds import draw_map, pose
from voxjax.pipeline import batch

T_MAP_WORLD = pose(yaw=-71.0, tilt=25.0, translation=(-4.0, 2.5, 0.7))


@pytest.fixture(scope="module")
def maps():
    return draw_map(), draw_map(T_MAP_WORLD)


def digest(found):
    parts = [
        found.T_a_b,
        found.covariance,
        np.float64(found.confidence),
        *(h.T_a_b for h in found.hypotheses),
    ]
    return hashlib.sha256(b"".join(np.ascontiguousarray(p).tobytes() for p in parts)).hexdigest()


def test_a_batch_gives_what_each_pair_gives_alone(maps, monkeypatch):
    a, b = maps
    prepared, told = [], []
    real = batch.features_at

    def features_at(grid, *, voxel_size, config):
        prepared.append(grid)
        return real(grid, voxel_size=voxel_size, config=config)

    monkeypatch.setattr(batch, "features_at", features_at)
    found = vx.register_batch([(a, b), (b, a), (a, a)], on_pair=lambda number, one: told.append(number))
    assert told == [0, 1, 2]
    assert len(prepared) == 2
    alone = [vx.register(a, b), vx.register(b, a), vx.register(a, a)]
    assert [digest(one) for one in found] == [digest(one) for one in alone]
    assert all(one.accepted for one in found)


def test_another_process_gives_the_same_bits(maps):
    here = digest(vx.register(*maps))
    code = (
        "import sys; sys.path[:0] = ['tests', 'tests/pipeline']\n"
        "import voxjax as vx\nfrom small_worlds import draw_map\nfrom test_batch import T_MAP_WORLD, digest\n"
        "print(digest(vx.register(draw_map(), draw_map(T_MAP_WORLD))))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=True
    )
    assert done.stdout.strip() == here


def test_maps_without_voxels_are_an_outcome(maps):
    empty = vx.VoxelGrid(np.zeros((4, 4, 4), np.uint8), np.zeros(3, np.float32), 0.15)
    assert vx.register_batch([]) == []
    assert vx.register_batch([(maps[0], empty)])[0].verdict == "no_overlap"


def test_wrong_entries_are_refused_where_types_are_not_checked():
    """In a process of its own: here the type checker of the tests would speak first."""
    code = (
        "import numpy as np, voxjax as vx\n"
        "grid = vx.VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3, np.float32), 0.1)\n"
        "try:\n    vx.register_batch([(grid, grid), (grid, 3)])\n"
        "except vx.InputError as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True
    )
    assert done.stdout.startswith("pairs[1][1] must be a VoxelGrid, got 3")
