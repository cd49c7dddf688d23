"""`voxjax convert`: any readable format to any writable one."""

from pathlib import Path

import numpy as np

from command_line import one_line
from fake_register import cube_map
from file_limits import largest_file
from voxjax import read_map
from voxjax.cli.main import main


def test_convert_and_back_gives_the_same_map(maps):
    assert main(["convert", "m0.npz", "a.bt"]) == 0
    assert main(["convert", "a.bt", "b.npz"]) == 0
    first, second = read_map("m0.npz").crop_to_known(), read_map("b.npz")
    np.testing.assert_array_equal(first.states, second.states)
    np.testing.assert_allclose(first.origin, second.origin)


def test_a_map_is_never_converted_in_place(maps):
    assert main(["convert", "m0.npz", "m0.npz"]) == 2
    assert main(["convert", "m0.npz", "m0.npz", "--voxel-size", "1.0", "--force"]) == 2
    assert read_map("m0.npz").equals(cube_map(0))
    assert main(["convert", "m0.npz", "m1.npz", "--voxel-size", "1.0", "--force"]) == 0
    assert read_map("m1.npz").equals(cube_map(0).with_voxel_size(1.0))


def test_a_store_is_written_and_read_like_a_file(maps, capsys):
    assert main(["convert", "m0.npz", "a.zarr"]) == 0
    assert main(["convert", "m1.npz", "a.zarr"]) == 2
    assert "a.zarr exists already; use --force" in one_line(capsys)
    assert main(["convert", "a.zarr", "a.zarr", "--force"]) == 2
    assert "a.zarr is one of the inputs" in one_line(capsys)
    assert main(["convert", "a.zarr", "b.npz"]) == 0
    assert Path("b.npz").read_bytes() == Path("m0.npz").read_bytes()
    assert main(["convert", "m1.npz", "a.zarr", "--force"]) == 0
    assert read_map("a.zarr").equals(cube_map(1))
    assert sorted(path.name for path in Path().iterdir()) == sorted([*maps, "a.zarr", "b.npz"])


def test_a_store_without_its_extra_is_refused_at_once(maps, capsys, monkeypatch):
    monkeypatch.setattr("voxjax.io.zarr_reading.find_spec", lambda name: None)
    assert main(["convert", "gone.npz", "a.zarr"]) == 2
    assert "voxjax[zarr]" in one_line(capsys)


def test_devices_are_no_outputs_even_with_force(maps, capsys):
    Path("full.bt").symlink_to("/dev/full")
    for name, words in (("/dev/full", "the ending must be"), ("full.bt", "full.bt is a device or a pipe")):
        assert main(["convert", "m0.npz", name, "--force"]) == 2
        assert words in one_line(capsys)
    assert Path("full.bt").is_symlink()


def test_a_map_beyond_the_limit_of_file_sizes_leaves_what_was_there(maps, capsys):
    before = Path("m1.npz").read_bytes()
    with largest_file(len(Path("m0.npz").read_bytes()) - 300):
        assert main(["convert", "m0.npz", "m1.npz", "--force"]) == 2
    assert "m1.npz cannot be written: File too large" in one_line(capsys)
    assert Path("m1.npz").read_bytes() == before
    assert sorted(path.name for path in Path().iterdir()) == sorted(maps)


def test_maps_are_scaled_and_moved(maps, capsys):
    grid = read_map("m0.npz")
    assert main(["convert", "m0.npz", "a.npz", "--scale", "0.001", "--shift", "450000.5,5.4e6,0.125"]) == 0
    moved = read_map("a.npz")
    assert moved.voxel_size == grid.voxel_size * 0.001
    np.testing.assert_array_equal(moved.origin, np.asarray(grid.origin) * 0.001 + [450000.5, 5.4e6, 0.125])
    np.testing.assert_array_equal(moved.states, grid.states)
    assert one_line(capsys).startswith("voxjax: m0.npz as a.npz: the map lies 5,4")
    # What a format cannot hold is said, with what helps.
    assert main(["convert", "m0.npz", "a.bt", "--shift", "0.1,0,0"]) == 2
    assert "origin at whole multiples of the voxel size 0.5 m" in one_line(capsys)
    assert main(["convert", "m0.npz", "a.bt", "--shift", "0.1,0,0", "--voxel-size", "0.5"]) == 0
    capsys.readouterr()
    assert main(["convert", "m0.npz", "b.bt", "--shift=-5e5,0,0"]) == 2
    assert "voxjax convert --shift" in capsys.readouterr().err
    assert not Path("b.bt").exists()
