import errno
import os
import stat
from pathlib import Path

import pytest

from file_limits import largest_file
from voxjax import InputError
from voxjax._runtime import whole_files
from voxjax._runtime.whole_files import check_writable, write_file, write_files


def failing(monkeypatch, name: str, when: Path | None, error: BaseException):
    """Let `os.<name>` raise; with `when`, only where that is its last argument."""
    real = getattr(os, name)

    def call(*args, **kwargs):
        if when is None or Path(args[-1]) == when:
            raise error
        return real(*args, **kwargs)

    monkeypatch.setattr(whole_files.os, name, call)


def test_files_appear_whole(tmp_path):
    write_files({tmp_path / "a.bin": b"whole", tmp_path / "b.bin": b""}, force=False)
    assert (tmp_path / "a.bin").read_bytes() == b"whole"
    assert sorted(os.listdir(tmp_path)) == ["a.bin", "b.bin"]


@pytest.mark.parametrize("force", [False, True])
def test_a_limit_that_one_file_breaks_leaves_none_and_keeps_the_old(tmp_path, force):
    if force:
        (tmp_path / "m.json").write_bytes(b"old")
    with (
        largest_file(9_700),
        pytest.raises(InputError, match=r"m\.bt cannot be written: File too large; make room"),
    ):
        write_files({tmp_path / "m.json": b"{}", tmp_path / "m.bt": bytes(10_000)}, force=force)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([b"old"] if force else [])


@pytest.mark.parametrize("step", ["fsync", "open"])
def test_a_disk_that_is_full_at_any_step_is_one_sentence(tmp_path, monkeypatch, step):
    failing(monkeypatch, step, None, OSError(errno.ENOSPC, "No space left on device"))
    with pytest.raises(InputError, match=r"a\.bin cannot be written: No space left on device; make room"):
        write_file(tmp_path / "a.bin", b"new", force=False)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("force", [False, True])
@pytest.mark.parametrize("error", [OSError(errno.EPERM, "Operation not permitted"), KeyboardInterrupt()])
def test_a_name_that_cannot_be_taken_takes_back_those_before(tmp_path, monkeypatch, force, error):
    first, second = tmp_path / "a.bin", tmp_path / "b.bin"
    if force:
        first.write_bytes(b"old")
    failing(monkeypatch, "link", second, FileNotFoundError() if force else error)
    failing(monkeypatch, "replace", second, error)
    with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else InputError):
        write_files({first: b"new", second: b"new"}, force=force)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == ([b"old"] if force else [])


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(143)])
def test_a_stopped_program_leaves_nothing(tmp_path, monkeypatch, error):
    failing(monkeypatch, "fsync", None, error)
    with pytest.raises(type(error)):
        write_file(tmp_path / "a.bin", b"new", force=True)
    assert os.listdir(tmp_path) == []


def test_nothing_is_overwritten_without_force(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"old")
    with pytest.raises(InputError, match="exists already; give force=True"):
        write_file(path, b"new", force=False)
    assert path.read_bytes() == b"old"
    write_file(path, b"new", force=True)
    assert path.read_bytes() == b"new"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_a_file_made_meanwhile_is_not_overwritten(tmp_path, monkeypatch):
    path, real = tmp_path / "a.bin", os.fsync

    def another_is_faster(descriptor):
        path.write_bytes(b"theirs")
        real(descriptor)

    monkeypatch.setattr(whole_files.os, "fsync", another_is_faster)
    with pytest.raises(InputError, match="exists already"):
        write_file(path, b"ours", force=False)
    assert path.read_bytes() == b"theirs"
    assert os.listdir(tmp_path) == ["a.bin"]


@pytest.mark.parametrize("force", [False, True])
def test_file_systems_without_links_serve_too(tmp_path, monkeypatch, force):
    failing(monkeypatch, "link", None, OSError(errno.EPERM, "Operation not permitted"))
    if force:
        (tmp_path / "a.bin").write_bytes(b"old")
    write_file(tmp_path / "a.bin", b"new", force=force)
    assert [p.read_bytes() for p in tmp_path.iterdir()] == [b"new"]


def test_a_dangling_link_is_replaced_with_force_alone(tmp_path):
    link = tmp_path / "m.bt"
    link.symlink_to(tmp_path / "gone" / "m.bt")
    with pytest.raises(InputError, match="is a link that leads nowhere; give force=True"):
        write_file(link, b"new", force=False)
    assert link.is_symlink()
    write_file(link, b"new", force=True)
    assert not link.is_symlink()
    assert link.read_bytes() == b"new"


def test_devices_and_pipes_are_not_replaced_even_with_force(tmp_path):
    os.mkfifo(tmp_path / "pipe.bt")
    (tmp_path / "full.bt").symlink_to("/dev/full")
    for name in ("pipe.bt", "full.bt"):
        with pytest.raises(InputError, match="is a device or a pipe"):
            write_file(tmp_path / name, b"new", force=True)
    assert stat.S_ISFIFO((tmp_path / "pipe.bt").stat().st_mode)
    assert (tmp_path / "full.bt").is_symlink()


def test_new_files_have_the_permissions_of_any_new_file(tmp_path):
    (tmp_path / "plain").write_bytes(b"")
    write_file(tmp_path / "ours", b"", force=False)
    write_file(tmp_path / "private", b"", force=False, mode=0o600)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("plain", "ours", "private")]
    assert modes[0] == modes[1]
    assert modes[2] == 0o600


def test_impossible_names_are_refused(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        check_writable(tmp_path / "no" / "a.bin", force=True)
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="does not exist"):
        check_writable(tmp_path / "file" / "a.bin", force=True)
    with pytest.raises(InputError, match="is a folder"):
        check_writable(tmp_path, force=True)
    for name, reason in (("n" * 300, "File name too long"), ("a\0b", "null")):
        with pytest.raises(InputError, match=f"cannot be written: .*{reason}"):
            check_writable(tmp_path / name, force=True)


def test_a_name_as_long_as_the_system_allows_can_be_written(tmp_path):
    write_file(tmp_path / ("\N{SNOWMAN}" * 85), b"new", force=False)
    assert len(os.listdir(tmp_path)) == 1


def test_a_folder_that_is_not_writable_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(whole_files.os, "access", lambda path, mode: (path, mode) != (tmp_path, os.W_OK))
    with pytest.raises(InputError, match="is not writable"):
        check_writable(tmp_path / "a.bin", force=True)
