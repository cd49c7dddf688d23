import numpy as np
import pytest

import voxjax as vx
from clouds import write_cloud
from voxjax import InputError, VoxelGrid
from voxjax.io import ENDINGS, decoding, load_map


def make_grid() -> VoxelGrid:
    states = np.random.default_rng(0).integers(0, 3, (6, 5, 4)).astype(np.uint8)
    states[[0, -1], 0, 0] = states[0, [0, -1], 0] = states[0, 0, [0, -1]] = 2
    return VoxelGrid(states, [-0.4, 0.8, 0.2], 0.2)


@pytest.mark.parametrize("ending", [".bt", ".ot", ".npz", ".PLY"])
def test_the_ending_chooses_the_format(tmp_path, ending):
    grid = make_grid()
    path = tmp_path / f"map{ending}"
    vx.write_map(path, grid)
    back = vx.read_map(str(path), voxel_size=0.2)
    assert (back.num_occupied, back.voxel_size) == (grid.num_occupied, 0.2)
    np.testing.assert_array_equal(back.occupied_points(), grid.occupied_points())
    assert back.num_free == (0 if ending == ".PLY" else grid.num_free)


def test_an_unknown_ending_lists_the_known_ones(tmp_path):
    for call in (lambda: vx.read_map("m.pcd"), lambda: vx.write_map(tmp_path / "m", make_grid())):
        with pytest.raises(InputError) as caught:
            call()
        assert all(ending in str(caught.value) for ending in ENDINGS)


def test_missing_files_and_folders_are_named(tmp_path):
    with pytest.raises(InputError, match=r"gone\.bt cannot be read: No such file"):
        vx.read_map(tmp_path / "gone.bt")
    (tmp_path / "folder.bt").mkdir()
    with pytest.raises(InputError, match=r"is a folder; give the name of a file"):
        vx.read_map(tmp_path)
    with pytest.raises(InputError, match=r"folder\.bt cannot be read"):
        vx.read_map(tmp_path / "folder.bt")


@pytest.mark.parametrize("ending", ENDINGS)
def test_the_sentence_names_the_damaged_file(tmp_path, ending):
    path = tmp_path / f"bad{ending}"
    path.write_bytes(b"garbage")
    with pytest.raises(InputError, match=f"bad{ending} cannot be read: ") as caught:
        vx.read_map(path, voxel_size=0.1)
    assert str(caught.value).count("\n") == 0
    assert str(caught.value).endswith(".")


def test_a_map_too_large_for_max_voxels_is_refused(tmp_path):
    vx.write_map(tmp_path / "m.bt", make_grid())
    with pytest.raises(InputError, match="limit of 50"):
        vx.read_map(tmp_path / "m.bt", max_voxels=50)


def test_write_map_overwrites_unless_told_not_to(tmp_path):
    path = tmp_path / "m.npz"
    vx.write_map(path, make_grid())
    vx.write_map(path, make_grid())
    with pytest.raises(InputError, match="exists already"):
        vx.write_map(path, make_grid(), force=False)


def test_another_voxel_size_is_a_change_of_resolution(tmp_path):
    grid = make_grid()
    vx.write_map(tmp_path / "m.npz", grid)
    assert vx.read_map(tmp_path / "m.npz", voxel_size=0.4) == grid.with_voxel_size(0.4)


def test_a_grid_off_octomaps_lattice_is_written_once_resampled(tmp_path):
    grid = VoxelGrid(make_grid().states, [-0.33, 0.8, 0.2], 0.2)
    with pytest.raises(InputError, match=r"m\.bt cannot be written.*--voxel-size"):
        vx.write_map(tmp_path / "m.bt", grid)
    assert not (tmp_path / "m.bt").exists()
    vx.write_map(tmp_path / "m.bt", grid.with_voxel_size(0.2))
    assert vx.read_map(tmp_path / "m.bt").num_occupied == grid.num_occupied


def test_clouds_take_sensor_origins(tmp_path):
    grid = VoxelGrid(np.pad(np.full((1, 1, 1), 2, np.uint8), ((5, 0), (0, 0), (0, 0))), np.zeros(3), 0.1)
    vx.write_map(tmp_path / "c.ply", grid)
    assert vx.read_map(tmp_path / "c.ply", voxel_size=0.1).num_free == 0
    seen = vx.read_map(tmp_path / "c.ply", voxel_size=0.1, sensor_origins=np.array([0.05, 0.05, 0.05]))
    assert (seen.num_occupied, seen.num_free) == (1, 5)
    vx.write_map(tmp_path / "c.npz", grid)
    with pytest.raises(InputError, match="belong to clouds"):
        vx.read_map(tmp_path / "c.npz", max_range=3.0)


def test_an_empty_cloud_is_refused(tmp_path):
    vx.write_map(tmp_path / "c.ply", VoxelGrid(np.zeros((2, 2, 2), np.uint8), np.zeros(3), 0.1))
    with pytest.raises(InputError, match="no points"):
        vx.read_map(tmp_path / "c.ply", voxel_size=0.1)


@pytest.mark.parametrize(
    ("far", "sentence"),
    [(1e6, "points span .* give a larger voxel_size"), (1e308, r"2 of 2 points lie beyond 1e\+12 m")],
)
def test_a_few_points_far_apart_are_refused(tmp_path, far, sentence):
    write_cloud(tmp_path / "c.ply", [(-far, 0.0, -far), (far, 90.0, far)])
    with pytest.raises(InputError, match=rf"c\.ply cannot be read: {sentence}"):
        vx.read_map(tmp_path / "c.ply", voxel_size=0.1)


def test_max_voxels_bounds_clouds_too(tmp_path):
    write_cloud(tmp_path / "c.ply", [(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
    assert vx.read_map(tmp_path / "c.ply", voxel_size=0.5, max_voxels=27).shape == (3, 3, 3)
    with pytest.raises(InputError, match="above the limit of 26"):
        vx.read_map(tmp_path / "c.ply", voxel_size=0.5, max_voxels=26)


@pytest.mark.real_maps
def test_good_maps_get_no_remarks(maps_folder):
    paths = sorted([*(maps_folder / "real").glob("*/?.*"), *(maps_folder / "sim").glob("*_0/?.bt")])
    found = {str(path): [r.code for r in load_map(path).remarks] for path in paths if path.suffix != ".json"}
    assert len(found) > 20
    for path, codes in found.items():
        assert codes == (["estimated_voxel_size"] if path.endswith(".ply") else []), path


@pytest.mark.parametrize("ending", [".ply", ".bt", ".ot"])
def test_a_map_that_cannot_be_packed_in_the_memory_is_refused(tmp_path, monkeypatch, ending):
    grid = VoxelGrid(np.random.default_rng(0).integers(1, 3, (64, 64, 64)).astype(np.uint8), np.zeros(3), 0.1)
    monkeypatch.setenv("VOXJAX_MEMORY", "0.001")
    with pytest.raises(
        InputError, match=rf"m\{ending} cannot be written: .* GB of memory .* write .* as \.npz"
    ):
        vx.write_map(tmp_path / f"m{ending}", grid)
    vx.write_map(tmp_path / "m.npz", grid)


def test_memory_that_the_system_does_not_grant_is_one_sentence(tmp_path, monkeypatch):
    def decode(data, **options):
        raise MemoryError

    vx.write_map(tmp_path / "m.bt", make_grid())
    monkeypatch.setitem(decoding._DECODERS, ".bt", decode)
    with pytest.raises(InputError, match=r"m\.bt cannot be read: this process may not take the memory"):
        vx.read_map(tmp_path / "m.bt")
