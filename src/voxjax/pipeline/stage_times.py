"""`Stages`: who listens hears which stage begins, and the seconds of each are kept."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

OnStage = Callable[[str], None]


class Stages:
    """Announces stages and measures them.

    Attributes:
        seconds: {name: s} of what was measured; a name that comes again adds to its seconds.
    """

    def __init__(self, on_stage: OnStage | None = None, seconds: dict[str, float] | None = None) -> None:
        """Begin with the seconds of stages that are done already.

        Args:
            on_stage: Called with the name of each announced stage as it starts; None where nobody listens.
            seconds: {name: s} of stages before; the caller's table is not changed.
        """
        self._on_stage = on_stage
        self.seconds = dict(seconds or {})

    def announce(self, name: str) -> None:
        """Tell who listens that a stage begins."""
        if self._on_stage is not None:
            self._on_stage(name)

    @contextmanager
    def measure(self, name: str) -> Iterator[None]:
        """Keep the seconds of the block under a name, without a word."""
        # The clock is a monotonic one: the time of day may be set while a stage runs.
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce the block and keep its seconds."""
        self.announce(name)
        with self.measure(name):
            yield
