"""What others could have written is not used: folders, files, links and pipes."""

import os

import pytest

from voxjax import InputError
from voxjax._runtime.private_folders import (
    NotPrivateError,
    private_folder,
    read_private,
    remove_foreign_files,
)

pytestmark = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs owners of files")

needs_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give a folder to someone else"
)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"content")
    path.chmod(0o600)
    return path


def _mode(path):
    return path.stat().st_mode & 0o7777


def test_folders_are_made_for_their_user_alone(tmp_path):
    path = tmp_path / "one" / "two" / "three"
    assert private_folder(path) == path
    assert [_mode(each) for each in (path, *path.parents[:2])] == [0o700] * 3
    assert private_folder(path) == path


@pytest.mark.parametrize("mode", [0o720, 0o702, 0o777, 0o1777])
def test_a_folder_that_others_can_write_is_refused(tmp_path, mode):
    path = tmp_path / "open"
    path.mkdir()
    path.chmod(mode)
    with pytest.raises(InputError, match="open can be written by others"):
        private_folder(path)
    assert _mode(path) == mode


def test_what_belongs_to_someone_else_is_refused(tmp_path, file, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: file.stat().st_uid + 1)
    with pytest.raises(InputError, match="belongs to someone else"):
        private_folder(tmp_path)
    with pytest.raises(NotPrivateError, match="belongs to someone else"):
        read_private(file)


@pytest.mark.parametrize("mode", [0o720, 0o770, 0o775, 0o702, 0o777])
def test_a_folder_that_others_can_replace_is_refused(tmp_path, mode):
    above, path = tmp_path / "above", tmp_path / "above" / "between" / "mine"
    private_folder(path)
    above.chmod(mode)
    with pytest.raises(InputError, match=r"others can write .*above above it \(chmod go-w\)"):
        private_folder(path)
    above.chmod(mode | 0o1000)
    private_folder(path)
    above.chmod(0o755)
    private_folder(path)


@needs_root
def test_a_folder_in_that_of_someone_else_is_refused(tmp_path):
    above, path = tmp_path / "above", tmp_path / "above" / "between" / "mine"
    private_folder(path)
    for mode in (0o755, 0o1777):  # the owner may rename what lies in a folder, sticky or not
        os.chown(above, 65534, 65534)
        above.chmod(mode)
        with pytest.raises(InputError, match=r"above above it belongs to someone else"):
            private_folder(path)
    os.chown(above, 0, 0)
    private_folder(path)


@needs_root
def test_a_link_on_the_way_must_lie_in_a_safe_place(tmp_path):
    strange = tmp_path / "strange"
    strange.mkdir()
    private_folder(tmp_path / "safe" / "mine")
    (strange / "link").symlink_to(tmp_path / "safe")
    assert private_folder(strange / "link" / "mine") == strange / "link" / "mine"
    os.lchown(strange / "link", 65534, 65534)
    with pytest.raises(InputError, match=r"link above it belongs to someone else"):
        private_folder(strange / "link" / "mine")
    os.lchown(strange / "link", 0, 0)
    os.chown(strange, 65534, 65534)
    with pytest.raises(InputError, match=r"strange above it belongs to someone else"):
        private_folder(strange / "link" / "mine")


def test_a_link_counts_as_what_it_leads_to(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    link.symlink_to(target)
    with pytest.raises(NotADirectoryError):
        private_folder(link)
    target.mkdir(mode=0o700)
    assert private_folder(link) == link
    target.chmod(0o777)
    with pytest.raises(InputError, match="can be written by others"):
        private_folder(link)


def test_a_file_is_read_only_if_nobody_else_can_have_written_it(tmp_path, file):
    assert read_private(file) == b"content"
    for mode in (0o620, 0o602):
        file.chmod(mode)
        with pytest.raises(NotPrivateError, match="can be written by others"):
            read_private(file)
    file.chmod(0o600)
    for name, target in (("link", file), ("dangling", tmp_path / "nowhere")):
        (tmp_path / name).symlink_to(target)
        with pytest.raises(OSError, match="link"):
            read_private(tmp_path / name)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(NotPrivateError, match="no file"):
        read_private(tmp_path / "pipe")


def test_foreign_files_are_removed_from_a_folder_whose_reader_asks_for_no_owner(tmp_path, file, monkeypatch):
    def names():
        return sorted(path.name for path in tmp_path.iterdir())

    (tmp_path / "open-cache").write_bytes(b"")
    (tmp_path / "open-cache").chmod(0o666)
    (tmp_path / "mine-cache").write_bytes(b"")
    (tmp_path / "link-cache").symlink_to(file)
    (tmp_path / "link-other").symlink_to(file)
    tmp_path.chmod(0o700)
    assert remove_foreign_files(tmp_path, "-cache") == 1
    assert names() == ["file", "link-other", "mine-cache", "open-cache"]
    tmp_path.chmod(0o755)
    assert remove_foreign_files(tmp_path, "-cache") == 1
    assert names() == ["file", "link-other", "mine-cache"]
    monkeypatch.setattr(os, "geteuid", lambda: file.stat().st_uid + 1)
    assert remove_foreign_files(tmp_path, "-cache") == 1
    assert names() == ["file", "link-other"]
