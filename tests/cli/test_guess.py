"""`--init-guess`: the forms a pose may have."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from oracles.motions import pose_of
from voxjax import InputError
from voxjax.cli.guess import parse_guess

_parts = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)
_place = st.lists(st.floats(-100, 100), min_size=3, max_size=3)


@given(place=_place, quaternion=_parts)
def test_all_forms_give_the_same_pose(place, quaternion):
    # SciPy's order is x, y, z, w as well.
    expected = pose_of(Rotation.from_quat(quaternion).as_matrix(), place)
    seven = " ".join(map(repr, [*place, *quaternion]))
    sixteen = ",".join(map(repr, expected.reshape(-1).tolist()))
    twelve = " ".join(map(repr, expected[:3].reshape(-1).tolist()))
    for text in (seven, f"1700000000.5 {seven}", sixteen, twelve):
        np.testing.assert_allclose(parse_guess(text), expected, atol=2e-5)


def test_a_file_may_hold_comments_and_lines(tmp_path):
    path = tmp_path / "pose.txt"
    path.write_text("# T_a_b\n0 -1 0 4\n1 0 0 5   # second row\n0 0 1 6\n0 0 0 1\n")
    np.testing.assert_allclose(parse_guess(str(path))[:3, 3], [4, 5, 6])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1 2 3", "3 numbers"),
        ("no such file", "is no file"),
        ("/dev/zero", "is no file .it is a device or a pipe"),
        ("0 0 0 0 0 0 0", "length 0"),
        ("nan 0 0 0 0 0 1", "not finite"),
        ("1e400 0 0 0 0 0 1", "not finite"),
        ("0 0 0 1e308 1e308 1e308 1e308", "length inf"),
        ("1e30 0 0 0 0 0 1", "move by less than"),
        ("1e308 1e308 1e308 0 0 0 1", "move by less than"),
        ("1e300 0 0 0 0 1e300 0 0 0 0 1e300 0", "rigid"),
        ("x" * 300, "is no file .File name too long"),
        ("a\0b", "is no file .embedded null byte"),
        (" ".join(["2"] * 16), "rigid"),
        ("", "is no file|Is a directory"),
    ],
)
def test_what_is_no_pose_is_refused(text, words):
    with pytest.raises(InputError, match=words):
        parse_guess(text)


def test_a_file_with_words_is_refused(tmp_path):
    path = tmp_path / "pose.txt"
    path.write_text("identity")
    with pytest.raises(InputError, match="other things than numbers"):
        parse_guess(str(path))
