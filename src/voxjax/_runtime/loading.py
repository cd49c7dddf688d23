"""Who loads a kept program, and when: each is loaded once, and those that were used last before anybody asks."""

import functools
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

from .program import Program
from .program_files import last_used, read_whole


class Loader:
    """Loads the programs of one folder, each once for all threads.

    Attributes:
        folder: Folder of the programs.
    """

    def __init__(self, folder: Path):
        """A loader that has loaded nothing yet."""
        self.folder = folder
        self._is_over = False
        self._loads: dict[Path, Future[Program | None]] = {}
        self._lock = threading.Lock()

    def start(self) -> None:
        """Begin to load ahead, in the background."""
        if any(self.folder.iterdir()):
            # It is no daemon: Python would stop a daemon in the middle of a compilation, whereas this one is waited
            # for, and ends after the program at hand.
            threading.Thread(target=self._load_ahead, name="voxjax programs").start()

    def end(self) -> None:
        """Load nothing more ahead: programs are kept elsewhere now."""
        self._is_over = True

    def once(self, path: Path, load: Callable[[], Program | None]) -> Program | None:
        """What `load` gives, run by whoever asks first for a path; others wait for it."""
        with self._lock:
            # The lock is held while a future is looked up, not while its program is loaded: other programs go on
            # meanwhile.
            future, is_first = self._loads.get(path), path not in self._loads
            if future is None:
                future = self._loads[path] = Future()
        if is_first:
            try:
                future.set_result(load())
            # Others may wait for this future, also when it is Ctrl-C that ends the load.
            except BaseException as error:
                with self._lock:
                    self._loads.pop(path, None)  # whoever asks again tries again
                future.set_exception(error)
                raise
        return future.result()

    def _load_ahead(self) -> None:
        """Load programs of these versions and their kernels, in the order in which they were used."""
        for path in last_used(self.folder):
            # Nobody waits for what is left when the program ends, or keeps its programs elsewhere.
            if self._is_over or not threading.main_thread().is_alive():
                return
            self.once(path, functools.partial(_ready, path))


def _ready(path: Path) -> Program | None:
    """The program of a file with its kernel compiled or loaded; None where there is none."""
    content = read_whole(path)
    program = None if content is None else Program.of(content)
    if program is not None:
        try:
            program.compile()
        except Exception as error:  # whoever asks for it tries again, and is told
            warnings.warn(f"a kept program was not compiled ahead: {error}", stacklevel=2)
            return None
    return program
