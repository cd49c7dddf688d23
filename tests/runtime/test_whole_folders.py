"""Folders that are written whole or not at all, beside files and in the place of older ones."""

import errno
import os

import pytest

from voxjax import InputError
from voxjax._runtime.whole_files import check_writable, write_files
from voxjax._runtime.whole_folders import Folder


def folder_of(text, *, fault=None):
    def write(path):
        (path / "part").mkdir(parents=True)
        (path / "mark.json").write_text(text)
        if fault is not None:
            raise fault
        (path / "part" / "0").write_text(text)

    return Folder(write, "mark.json")


def content(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()
    }


def whole(text):
    return {"mark.json": text, "part/0": text}


def test_a_folder_appears_whole_beside_a_file(tmp_path):
    write_files({tmp_path / "m.zarr": folder_of("new"), tmp_path / "r.json": b"{}"}, force=False)
    assert content(tmp_path / "m.zarr") == whole("new")
    assert sorted(os.listdir(tmp_path)) == ["m.zarr", "r.json"]


def test_what_has_the_name_is_replaced_with_force_alone(tmp_path):
    path = tmp_path / "m.zarr"
    write_files({path: folder_of("old")}, force=False)
    with pytest.raises(InputError, match=r"m\.zarr exists already; give force=True"):
        write_files({path: folder_of("new")}, force=False)
    assert content(path) == whole("old")
    write_files({path: folder_of("new")}, force=True)
    assert content(path) == whole("new")
    link = tmp_path / "link.zarr"
    link.symlink_to(path)
    write_files({link: folder_of("third")}, force=True)
    assert not link.is_symlink()
    assert (content(link), content(path)) == (whole("third"), whole("new"))
    plain = tmp_path / "plain.zarr"
    plain.write_bytes(b"a file")
    write_files({plain: folder_of("fourth")}, force=True)
    assert content(plain) == whole("fourth")
    assert sorted(os.listdir(tmp_path)) == ["link.zarr", "m.zarr", "plain.zarr"]


def test_folders_of_other_things_are_never_replaced(tmp_path):
    (tmp_path / "m.zarr").mkdir()
    (tmp_path / "m.zarr" / "thesis.txt").write_text("all of it")
    with pytest.raises(InputError, match=r"is a folder without a file mark\.json, which is never replaced"):
        write_files({tmp_path / "m.zarr": folder_of("new")}, force=True)
    with pytest.raises(InputError, match="is a folder; give the name of a file"):
        check_writable(tmp_path / "m.zarr", force=True)
    assert content(tmp_path) == {"m.zarr/thesis.txt": "all of it"}


@pytest.mark.parametrize("fault", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("force", [False, True])
def test_a_folder_that_cannot_be_written_leaves_nothing_and_keeps_the_old(tmp_path, force, fault):
    path = tmp_path / "m.zarr"
    if force:
        write_files({path: folder_of("old")}, force=False)
    with pytest.raises((InputError, KeyboardInterrupt)) as caught:
        write_files({tmp_path / "r.json": b"{}", path: folder_of("new", fault=fault)}, force=force)
    if isinstance(fault, OSError):
        assert "m.zarr cannot be written: No space left on device; make room" in str(caught.value)
    assert os.listdir(tmp_path) == (["m.zarr"] if force else [])
    assert not force or content(path) == whole("old")


@pytest.mark.parametrize(
    ("is_there", "failing"), [(True, 1), (True, 2), (True, None), (False, 1), (False, None)]
)
def test_a_name_that_cannot_be_taken_takes_back_those_before(tmp_path, monkeypatch, is_there, failing):
    """The old folder is named aside first; with `failing` None it is the file after the folder that gets no name."""
    path, calls, rename = tmp_path / "m.zarr", [], os.rename
    if is_there:
        write_files({path: folder_of("old")}, force=False)

    def call(*args):
        calls.append(args)
        if len(calls) == failing:
            raise OSError(errno.EPERM, "Operation not permitted")
        rename(*args)

    def refuse(*args, **kwargs):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "rename", call)
    monkeypatch.setattr(os, "replace", refuse)
    with pytest.raises(InputError, match="cannot be written: Operation not permitted"):
        write_files({path: folder_of("new"), tmp_path / "r.json": b"{}"}, force=True)
    assert os.listdir(tmp_path) == (["m.zarr"] if is_there else [])
    assert not is_there or content(path) == whole("old")


def test_a_folder_that_another_process_has_made_meanwhile_is_kept(tmp_path, monkeypatch):
    path = tmp_path / "m.zarr"

    def write(folder):
        folder_of("new").write(folder)
        folder_of("of another process").write(path)

    with pytest.raises(InputError, match=r"m\.zarr cannot be written"):
        write_files({path: Folder(write, "mark.json")}, force=False)
    assert content(path) == whole("of another process")
    assert os.listdir(tmp_path) == ["m.zarr"]
