"""Signals and descriptors of a process that runs one command."""

import gc
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from voxjax import VoxelGrid, write_map
from voxjax.cli.process import Stopped, garbage_collection_put_off, signals_raise

RUN = "; from voxjax.__main__ import main; sys.exit(main())"
"""What the command `voxjax` does, after whatever a test has prepared."""


@pytest.fixture(autouse=True)
def _in_a_folder_with_one_map(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map("m.npz", VoxelGrid(np.full((2, 2, 2), 2, np.uint8), np.zeros(3, np.float32), 0.5))


def _voxjax(prepare, *arguments, **options):
    command = [sys.executable, "-c", f"import os, signal, sys; {prepare}{RUN}", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60, **options)


INTERRUPTED_IMPORT = """exec('''
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
''')"""


@pytest.mark.parametrize(
    "name", ["voxjax.cli.main", "argparse", "voxjax.cli.info", "numpy.linalg", "jax._src.config"]
)
def test_ctrl_c_while_python_imports_gives_no_traceback(name):
    done = _voxjax(INTERRUPTED_IMPORT.format(name=name), "info", "m.npz")
    assert done.returncode == 130
    assert done.stdout == ""
    assert done.stderr in ("", "voxjax: stopped.\n")


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_during_the_writing_leaves_no_file(name, code):
    stop = f"os.fsync = lambda _: os.kill(os.getpid(), signal.{name})"
    done = _voxjax(stop, "convert", "m.npz", "out.bt")
    assert done.returncode == code
    assert [path.name for path in Path().iterdir()] == ["m.npz"]
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert done.stderr.startswith("voxjax: stopped")


def test_nohup_is_respected():
    ignore = "signal.signal(signal.SIGHUP, signal.SIG_IGN); real = os.fsync; "
    hang_up = "os.fsync = lambda file: (os.kill(os.getpid(), signal.SIGHUP), real(file))"
    done = _voxjax(ignore + hang_up, "convert", "m.npz", "out.bt")
    assert done.returncode == 0, done.stderr
    assert Path("out.bt").is_file()


def test_closed_descriptors_do_not_become_files():
    done = subprocess.run(
        f"{sys.executable} -m voxjax convert m.npz out.bt <&- >&- 2>&-", shell=True, check=False, timeout=60
    )
    assert done.returncode == 0
    assert Path("out.bt").read_bytes().startswith(b"# Octomap")


ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@pytest.fixture
def handlers():
    """Handlers of the signals that end a process; they are put back after the test."""
    before = {number: signal.getsignal(number) for number in ENDING}
    yield before
    for number, handler in before.items():
        signal.signal(number, handler)


def _send(number):
    os.kill(os.getpid(), number)
    for _ in range(1000):  # Python runs a handler between two steps
        pass


def test_handlers_are_put_back(handlers):
    with signals_raise():
        assert signal.getsignal(signal.SIGTERM) is not handlers[signal.SIGTERM]
    assert {number: signal.getsignal(number) for number in ENDING} == handlers


@pytest.mark.parametrize("first", ENDING)
def test_the_first_signal_counts_and_later_ones_do_not_break_the_cleaning_up(first, handlers):
    cleaned = []

    def stopped():
        with signals_raise():
            try:
                _send(first)
            finally:
                for number in ENDING:
                    _send(number)
                cleaned.append("inside")

    with pytest.raises(KeyboardInterrupt if first == signal.SIGINT else Stopped) as raised:
        stopped()
    for number in ENDING:  # whoever called cleans up as well
        _send(number)
    assert cleaned == ["inside"]
    if isinstance(raised.value, Stopped):
        assert raised.value.exit_code == 128 + first


def test_signals_that_come_together_stop_once(handlers):
    def stopped():
        with signals_raise():
            signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
            try:
                for number in ENDING:
                    signal.raise_signal(number)  # to this thread: another one does not block them
            finally:
                signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)

    with pytest.raises((KeyboardInterrupt, Stopped)):
        stopped()
    _send(signal.SIGTERM)


AGAIN = """exec('''
import pathlib
unlink = pathlib.Path.unlink
def again(path, **options):
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(os.getpid(), number)
    unlink(path, **options)
pathlib.Path.unlink = again
os.fsync = lambda _: os.kill(os.getpid(), signal.{name})
''')"""


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_further_signals_during_the_cleaning_up_leave_no_file(name, code):
    done = _voxjax(AGAIN.format(name=name), "convert", "m.npz", "out.bt")
    assert done.returncode == code
    assert [path.name for path in Path().iterdir()] == ["m.npz"]
    assert len(done.stderr.splitlines()) == 1


def test_garbage_is_collected_again_after_the_imports():
    assert gc.isenabled()
    with garbage_collection_put_off(for_good=False):
        assert not gc.isenabled()
    assert gc.isenabled()
