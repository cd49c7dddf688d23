import os
import stat

import pytest

from voxjax import InputError
from voxjax.io.atomic import check_writable, open_atomic, write_bytes


def test_a_file_appears_whole(tmp_path):
    write_bytes(tmp_path / "a.bin", b"whole", force=False)
    assert (tmp_path / "a.bin").read_bytes() == b"whole"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_a_file_that_fails_midway_leaves_nothing_and_keeps_the_old(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")

    def fail_midway() -> None:
        with open_atomic(path, force=True) as file:
            file.write(b"half")
            raise RuntimeError("midway")

    with pytest.raises(RuntimeError, match="midway"):
        fail_midway()
    assert path.read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_nothing_is_overwritten_without_force(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="exists already; use --force"):
        write_bytes(path, b"new", force=False)
    assert path.read_bytes() == b"old"
    write_bytes(path, b"new", force=True)
    assert path.read_bytes() == b"new"


def test_a_file_made_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "a.bin"

    def write_while_another_does() -> None:
        with open_atomic(path, force=False) as file:
            file.write(b"ours")
            path.write_bytes(b"theirs")

    with pytest.raises(InputError, match="exists already"):
        write_while_another_does()
    assert path.read_bytes() == b"theirs"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_new_files_have_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_bytes(tmp_path / "ours", b"", force=False)
    modes = {stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "ours")}
    assert len(modes) == 1


def test_missing_folders_and_folders_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        check_writable(tmp_path / "no" / "a.bin", force=True)
    with pytest.raises(InputError, match="is a folder"):
        check_writable(tmp_path, force=True)
