"""The commonest slips of arguments, at every public verb: one sentence, as `InputError`.

They run in a process of their own, without the checks of annotations that all other tests run under and users do not.
"""

import json
import subprocess
import sys

import pytest

SLIPS = {
    "vx.register('a.bt', grid)": "a must be a VoxelGrid, got 'a.bt'; read it with vx.read_map.",
    "vx.register(grid, None)": "b must be a VoxelGrid, got None; read it with vx.read_map.",
    "vx.register_batch([('a.bt', grid)])": "pairs[0][0] must be a VoxelGrid, got 'a.bt'",
    "vx.register_batch([grid])": "pairs[0] must be a list of VoxelGrid maps, got VoxelGrid(",
    "vx.register_batch([(grid,)])": "pairs[0] must be two VoxelGrid maps (a, b), got 1.",
    "vx.register_batch(grid)": "pairs must be a list of pairs (a, b) of maps, got VoxelGrid(",
    "vx.merge(['a.bt', 'b.bt'])": "grids[0] must be a VoxelGrid, got 'a.bt'; read it with vx.read_map.",
    "vx.merge('a.bt')": "grids must be a list of VoxelGrid maps, got 'a.bt'; put one alone into a list.",
    "vx.merge(grid)": "grids must be a list of VoxelGrid maps, got VoxelGrid(",
    "vx.fuse(grid, grid)": "grids must be a list of VoxelGrid maps, got VoxelGrid(",
    "vx.fuse([grid], grid)": "poses must be a list of (4, 4) poses, got VoxelGrid(",
    "vx.fuse([np.eye(4)], [grid])": "grids[0] must be a VoxelGrid, got array(",
    "vx.fuse([grid], [np.eye(4)], interpolation='trilinear', onto='a.bt')": "onto must be a VoxelGrid",
    "vx.write_map(grid, 'o.npz')": "path must be the name of a file, got VoxelGrid(",
    "vx.write_map('o.npz', 'o.npz')": "grid must be a VoxelGrid, got 'o.npz'",
    "vx.read_map(grid)": "path must be the name of a file, got VoxelGrid(",
    "vx.detect_corners('a.bt')": "grid must be a VoxelGrid, got 'a.bt'; read it with vx.read_map.",
    "vx.classify_voxels(grid)": "occupied must be an array (x, y, z), got a VoxelGrid; give grid.states == 2.",
    "vx.consistency_graph(grid, grid)": "corners_a must be Corners, as detect_corners gives them, got VoxelGrid(",
    "vx.maximum_common_subgraph(grid, grid)": "corners_a must be Corners, as detect_corners gives them, got VoxelGrid(",
    "vx.refine('a.bt', grid, np.eye(4))": "a must be a VoxelGrid, got 'a.bt'; read it with vx.read_map.",
    "vx.refine(grid, grid, np.eye(4), terms=term)": "terms must be a list of terms, got Prior(",
    "vx.refine(grid, grid, np.eye(4), terms=[grid])": "terms[0] must be a Term, got VoxelGrid(",
    "vx.refine_joint(['a.bt', grid], [np.eye(4)] * 2)": "grids[0] must be a VoxelGrid, got 'a.bt'",
    "vx.refine_joint(grid, [np.eye(4)])": "grids must be a list of maps, got VoxelGrid(",
    "vx.refine_joint([grid, grid], None)": "poses must be a list of (4, 4) poses, got None",
    "vx.refine_joint([grid, grid], [np.eye(4)] * 2, terms=[term])": "terms must be a mapping from pairs (a, b)",
    "vx.refine_joint([grid, grid], [np.eye(4)] * 2, terms={(0, 1): term})": "terms[(0, 1)] must be a list of terms",
}
"""Each call with the beginning of what it says."""


@pytest.fixture(scope="module")
def said():
    """What each call says: the kind of the error and its text."""
    code = """
import json, sys
import numpy as np
import voxjax as vx
from voxjax.refinement import Prior
grid = vx.VoxelGrid(np.full((3, 3, 3), 2, np.uint8), np.zeros(3), 0.1)
term = Prior(*(np.zeros(shape, np.float32) for shape in ((4, 4), (3,), (6, 6))))
said = {}
for call in json.load(sys.stdin):
    try:
        eval(call)
        said[call] = ["", "no error"]
    except Exception as error:
        said[call] = [type(error).__name__, str(error)]
print(json.dumps(said))
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps(list(SLIPS)),
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.mark.parametrize("call", SLIPS)
def test_a_slip_is_one_sentence(said, call):
    kind, text = said[call]
    assert (kind, text[: len(SLIPS[call])]) == ("InputError", SLIPS[call])
    assert text.endswith(".")
