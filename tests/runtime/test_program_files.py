"""Files of kept programs: read whole or not at all, and listed by their last use."""

import os

import pytest

from voxjax._runtime.program_files import (
    KeptProgramWarning,
    last_used,
    mark_as_used,
    program_path,
    read_whole,
    write_whole,
)


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "programs"
    folder.mkdir(mode=0o700)
    return folder


def test_what_was_written_is_read_and_no_part_of_it(folder):
    path = program_path(folder, "a" * 64)
    assert read_whole(path) is None
    write_whole(path, b"a program")
    assert read_whole(path) == b"a program"
    assert path.stat().st_mode & 0o777 == 0o600
    content = path.read_bytes()
    for damaged in (b"", content[:-1], content[:-1] + b"?"):
        path.write_bytes(damaged)
        assert read_whole(path) is None


def test_the_last_used_come_last(folder):
    paths = [program_path(folder, letter * 64) for letter in "abcd"]
    for number, path in enumerate(paths):
        write_whole(path, b"x")
        os.utime(path, (number, number))
    (folder / "another.program").write_bytes(b"x")
    assert last_used(folder) == paths
    mark_as_used(paths[0])
    assert last_used(folder, most=2) == [paths[3], paths[0]]


def test_a_folder_that_cannot_be_written_is_said(folder):
    with pytest.warns(KeptProgramWarning, match="cannot be kept"):
        write_whole(folder / "missing" / "x.program", b"x")
    mark_as_used(folder / "missing" / "x.program")
