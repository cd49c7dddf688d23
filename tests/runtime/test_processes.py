"""Processes that share work: each calls its share, what fails is said once, and none stays."""

import os
import signal
import subprocess
import sys
import time

import pytest

from voxjax import InputError
from voxjax._runtime import processes
from voxjax._runtime.processes import run_in_processes


def note(folder, number):
    """Print to the standard output, which is no channel of the answer, and leave a file with the number."""
    print("printed by a share")
    (folder / str(number)).write_text(str(os.getpid()))


def fail(folder, number):
    """The second share fails as it is told; the first would go on for long."""
    (folder / str(os.getpid())).touch()
    if number == 0:
        time.sleep(600)
    raise {
        1: InputError("the map is odd."),
        2: OSError(28, "No space left on device"),
        3: ValueError("2 < 1"),
    }[number]


def die(how):
    """End without an answer."""
    if how == "exit":
        os._exit(5)
    os.kill(os.getpid(), signal.SIGKILL if how == "kill" else signal.SIGTERM)


@pytest.fixture(autouse=True)
def _importable(monkeypatch):
    """The processes find this file."""
    monkeypatch.setattr(sys, "path", [os.path.dirname(__file__), *sys.path])
    for function in (note, fail, die):
        monkeypatch.setattr(function, "__module__", "test_processes")
    monkeypatch.setitem(sys.modules, "test_processes", sys.modules[__name__])


def test_each_share_is_called_in_a_process_of_its_own(tmp_path):
    run_in_processes(note, [(tmp_path, number) for number in range(2)])
    seen = {(tmp_path / str(number)).read_text() for number in range(2)}
    assert len(seen | {str(os.getpid())}) == 3


def test_files_of_the_folder_in_which_this_process_runs_are_not_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("pickle", "struct", "signal"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit(0)")
    (tmp_path / "out").mkdir()
    run_in_processes(note, [(tmp_path / "out", 0)])
    assert os.listdir(tmp_path / "out") == ["0"]


def test_what_a_process_prints_while_it_starts_is_no_answer(tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text("print('hello', flush=True)")
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    run_in_processes(note, [(tmp_path, 7)])
    assert (tmp_path / "7").exists()


@pytest.mark.parametrize(
    ("number", "error", "text"),
    [
        (1, InputError, "the map is odd."),
        (2, OSError, "No space left"),
        (3, RuntimeError, "ValueError: 2 < 1"),
    ],
)
def test_a_failure_is_raised_and_stops_the_others(tmp_path, number, error, text):
    with pytest.raises(error, match=text):
        run_in_processes(fail, [(tmp_path, 0), (tmp_path, number)])
    for name in os.listdir(tmp_path):
        with pytest.raises(ProcessLookupError):
            os.kill(int(name), 0)


@pytest.mark.parametrize(
    ("how", "error", "text"),
    [
        ("exit", RuntimeError, "ended with exit code 5"),
        ("term", InputError, "one of the processes was ended from outside by SIGTERM; run it again"),
        ("kill", InputError, "one of the processes was killed, .* use fewer processes, or find more memory"),
    ],
)
def test_a_process_that_dies_is_said(how, error, text):
    with pytest.raises(error, match=text):
        run_in_processes(die, [(how,)])


def test_a_process_whose_parent_has_gone_ends():
    code = """
import threading, time
from voxjax._runtime.processes import _end_with_parent
threading.Thread(target=_end_with_parent, daemon=True).start()
time.sleep(600)
"""
    child = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE)
    assert child.stdin is not None
    child.stdin.close()
    assert child.wait(120) == 1


def test_kernels_run_and_are_kept_where_they_do_here():
    settings = processes._settings_of_jax()
    assert settings["jax_platforms"] == "cpu"
    assert "jax_compilation_cache_dir" in settings
