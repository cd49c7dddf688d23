"""The budget of an exact search: a number of nodes, and a time where one is wanted."""

import time
from dataclasses import dataclass, field
from typing import Literal


@dataclass
class SearchBudget:
    """What a search may spend.

    Attributes:
        max_nodes: Nodes of the search tree.
        max_seconds: Wall time from the making of the budget [s]; None for no limit. What a search finds within a time
            depends on the machine; within a number of nodes it does not.
        num_nodes: Nodes spent so far.
        stopped_by: The limit that was hit, or None.
    """

    max_nodes: int
    max_seconds: float | None = None
    num_nodes: int = 0
    stopped_by: Literal["nodes", "time"] | None = None
    _start: float = field(default_factory=time.perf_counter)

    def spend(self) -> bool:
        """Count one node; False once a limit is hit."""
        # Nodes between two looks at the clock; they take a few milliseconds.
        nodes_a_look = 64
        self.num_nodes += 1
        if self.num_nodes > self.max_nodes:
            self.stopped_by = "nodes"
        elif self.num_nodes % nodes_a_look == 0:
            self.look()
        return self.stopped_by is None

    def look(self) -> bool:
        """Look at the clock; False once a limit is hit."""
        if self.stopped_by is None and self.max_seconds is not None:
            if time.perf_counter() - self._start > self.max_seconds:
                self.stopped_by = "time"
        return self.stopped_by is None
