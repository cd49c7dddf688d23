"""`voxjax merge` on real maps with known truth; only where VOXJAX_MAPS names their folder."""

import json

import numpy as np
import pytest

import voxjax as vx
from voxjax.cli.main import main
from voxjax.metrics import pose_error

octomap = pytest.importorskip("octomap")

pytestmark = pytest.mark.real_maps


def merge(folder, tmp_path, ending, *options):
    """Exit code, report and output of the command, and the error of the pose with its tolerances."""
    truth = json.loads((folder / "truth.json").read_text())
    files = [str(folder / f"{m}{ending}") for m in "ab"]
    out, report = tmp_path / "fused.bt", tmp_path / "report.json"
    code = main(["merge", *files, "-o", str(out), "--report", str(report), "-q", *options])
    found = json.loads(report.read_text())
    b = vx.read_map(files[1], voxel_size=truth["resolution"] if ending == ".ply" else None)
    centroid = b.occupied_points().mean(axis=0, dtype=np.float64)
    error = pose_error(np.asarray(found["pairs"][0]["T_a_b"]), np.asarray(truth["T_a_b"]), centroid)
    is_right = error.degrees <= truth["rot_tol_deg"] and error.metres <= truth["trans_tol_m"]
    return code, found, out, is_right


@pytest.mark.parametrize("name", ["split_geb079", "split_freiburg1_360"])
def test_two_octomap_files_become_one_that_octomap_reads(name, maps_folder, tmp_path):
    code, report, out, is_right = merge(maps_folder / "real" / name, tmp_path, ".bt")
    assert code == 0
    assert is_right
    assert report["status"] == "merged"
    assert report["pairs"][0]["accepted"]
    fused = vx.read_map(out)
    tree = octomap.OcTree(str(out).encode())
    counts = {True: 0, False: 0}
    for leaf in tree.begin_leafs():  # a pruned leaf stands for a cube of voxels
        counts[tree.isNodeOccupied(leaf)] += 8 ** (tree.getTreeDepth() - leaf.getDepth())
    assert counts[True] == fused.num_occupied
    assert counts[False] == fused.num_free


@pytest.mark.parametrize("name", ["pcl_room", "eth_apartment"])
def test_clouds_without_free_space_get_the_true_pose(name, maps_folder, tmp_path):
    folder = maps_folder / "real" / name
    size = json.loads((folder / "truth.json").read_text())["resolution"]
    code, _, _, is_right = merge(folder, tmp_path, ".ply", "--voxel-size", str(size))
    assert is_right
    assert code in (0, 3)


@pytest.mark.parametrize("name", ["balm_r25_AB", "balm_r10_AC"])
def test_halls_are_right_or_refused(name, maps_folder, tmp_path):
    code, report, _, is_right = merge(maps_folder / "real" / name, tmp_path, ".bt")
    assert (code == 0 and is_right) or (code == 3 and not report["pairs"][0]["accepted"])
