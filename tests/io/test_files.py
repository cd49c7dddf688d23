import os

import pytest

from voxjax import InputError, read_map
from voxjax.io import budget
from voxjax.io.files import read_bytes


def test_a_file_is_read_whole(tmp_path):
    (tmp_path / "a").write_bytes(b"whole")
    assert read_bytes(tmp_path / "a") == b"whole"
    assert read_bytes(str(tmp_path / "a"), most=5) == b"whole"


@pytest.mark.parametrize("ending", [".bt", ".ot", ".npz", ".ply"])
def test_pipes_and_devices_are_refused_and_nobody_waits(tmp_path, ending):
    os.mkfifo(tmp_path / f"pipe{ending}")
    for name, device in (("zero", "/dev/zero"), ("null", "/dev/null")):
        (tmp_path / f"{name}{ending}").symlink_to(device)
    for name in ("pipe", "zero", "null"):
        with pytest.raises(InputError, match=f"{name}{ending} cannot be read: it is a device or a pipe"):
            read_map(tmp_path / f"{name}{ending}", voxel_size=0.1)


def test_a_pipe_that_takes_the_place_of_a_file_is_refused_too(tmp_path, monkeypatch):
    path = tmp_path / "m.bt"
    path.write_bytes(b"")
    status = path.stat()
    path.unlink()
    os.mkfifo(path)
    monkeypatch.setattr("voxjax.io.files.Path.stat", lambda self: status)
    with pytest.raises(InputError, match="device or a pipe"):
        read_bytes(path)


def test_folders_missing_files_and_impossible_names_are_one_sentence(tmp_path):
    with pytest.raises(InputError, match="is a folder"):
        read_bytes(tmp_path)
    with pytest.raises(InputError, match="No such file"):
        read_bytes(tmp_path / "gone")
    with pytest.raises(InputError, match="File name too long"):
        read_bytes(tmp_path / ("n" * 300))
    with pytest.raises(InputError, match="null"):
        read_bytes("a\0b")


def test_a_file_beyond_the_limit_or_the_memory_is_not_read(tmp_path, monkeypatch):
    with open(tmp_path / "sparse", "wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match="holds 1,099,511,627,776 bytes, more than the 1,000"):
        read_bytes(tmp_path / "sparse", most=1000)
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    monkeypatch.setattr(budget, "available_memory", lambda: 10**9)
    with pytest.raises(
        InputError, match=r"the file itself needs about 1.1e\+03 GB of memory, and 1 GB are available"
    ):
        read_bytes(tmp_path / "sparse")
