"""`voxjax convert`: any readable format to any writable one."""

import numpy as np

from fake_register import cube_map
from voxjax import read_map
from voxjax.cli.main import main


def test_convert_and_back_gives_the_same_map(maps):
    assert main(["convert", "m0.npz", "a.bt"]) == 0
    assert main(["convert", "a.bt", "b.npz"]) == 0
    first, second = read_map("m0.npz").crop_to_known(), read_map("b.npz")
    np.testing.assert_array_equal(first.states, second.states)
    np.testing.assert_allclose(first.origin, second.origin)


def test_a_map_can_be_converted_in_place(maps):
    assert main(["convert", "m0.npz", "m0.npz"]) == 2
    assert main(["convert", "m0.npz", "m0.npz", "--voxel-size", "1.0", "--force"]) == 0
    assert read_map("m0.npz").equals(cube_map(0).with_voxel_size(1.0))
