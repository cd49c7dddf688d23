import threading

import pytest

from voxjax._runtime.loading import Loader
from voxjax._runtime.program import Program
from voxjax._runtime.program_files import program_path, write_whole


def test_a_program_is_loaded_once_and_all_who_ask_get_it(tmp_path):
    loader, begun, may_end = Loader(tmp_path), threading.Event(), threading.Event()
    program, loads, found = Program(None, [], None, False), [], []

    def load():
        loads.append(1)
        begun.set()
        assert may_end.wait(10)
        return program

    def ask():
        found.append(loader.once(tmp_path / "a", load))

    threads = [threading.Thread(target=ask) for _ in range(3)]
    threads[0].start()
    assert begun.wait(10)
    for thread in threads[1:]:
        thread.start()
    # While one is loaded, another can be.
    assert loader.once(tmp_path / "b", lambda: None) is None
    may_end.set()
    for thread in threads:
        thread.join(10)
    assert found == [program] * 3
    assert len(loads) == 1


def test_a_load_that_failed_is_tried_again(tmp_path):
    loader = Loader(tmp_path)

    def fail():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        loader.once(tmp_path / "a", fail)
    assert loader.once(tmp_path / "a", lambda: None) is None


def ahead(loader):
    """Let a loader load ahead; the paths that it asked for."""
    loader.start()
    for thread in threading.enumerate():
        if thread.name == "voxjax programs":
            thread.join(10)
    return list(loader._loads)


def test_programs_are_loaded_ahead_until_the_end(tmp_path):
    assert ahead(Loader(tmp_path)) == []
    path = program_path(tmp_path, "a" * 64)
    write_whole(path, b"no program")
    assert ahead(Loader(tmp_path)) == [path]
    ended = Loader(tmp_path)
    ended.end()
    assert ahead(ended) == []
