"""Compiled kernels kept between processes: where, what, and what happens when they cannot be."""

import pytest

from cache_runs import COMMAND, COUNTED, KERNEL, kernel_entries, run_process
from voxjax import InputError
from voxjax._runtime.compilation_cache import default_cache_folder, use_compilation_cache


def test_the_library_keeps_nothing_unless_asked(tmp_path):
    body = f"import voxjax.ops\n{KERNEL}"
    assert run_process(f"{COUNTED}{body}", tmp_path)[0] == ["15.0", "0 0"]
    asked = (
        f"{COUNTED}from voxjax._runtime.compilation_cache import use_compilation_cache as use\nuse()\n{body}"
    )
    assert run_process(asked, tmp_path)[0] == ["15.0", "0 1"]
    assert run_process(asked, tmp_path)[0] == ["15.0", "1 0"]


def test_a_folder_that_cannot_be_is_refused(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(InputError, match="Not a directory"):
        use_compilation_cache(file / "folder")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("pathlib.Path.home", lambda: (_ for _ in ()).throw(RuntimeError("no home")))
    with pytest.raises(InputError, match="no home"):
        default_cache_folder()


def test_the_folder_is_closed_to_others_and_links_in_it_are_not_followed(tmp_path):
    run_process(COMMAND, tmp_path)
    folder = tmp_path / "voxjax" / "xla"
    made = (folder.parent, folder, folder / "programs")
    assert [path.stat().st_mode & 0o777 for path in made] == [0o700] * 3
    (entry,) = kernel_entries(tmp_path)
    entry.unlink()
    entry.symlink_to(tmp_path / "nowhere")
    shown, said = run_process(COMMAND, tmp_path)
    assert shown == ["15.0", "0 1"]
    (line,) = said.splitlines()
    assert line.startswith("voxjax: 1 kernels in ")
    assert not (tmp_path / "nowhere").exists()
    assert run_process(COMMAND, tmp_path) == (["15.0", "1 0"], "")
