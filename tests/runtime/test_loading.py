import threading

import pytest

from voxjax._runtime.loading import Loader
from voxjax._runtime.program import Program


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


def test_nothing_is_loaded_ahead_from_an_empty_folder_nor_after_the_end(tmp_path):
    loader = Loader(tmp_path)
    before = threading.active_count()
    loader.start()
    assert threading.active_count() == before
    (tmp_path / "file").write_bytes(b"no program")
    loader.end()
    loader.start()
    for thread in threading.enumerate():
        if thread.name == "voxjax programs":
            thread.join(10)
    assert not loader._loads
