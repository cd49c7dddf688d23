"""What one row of `python -m bench kernels` measures, and against what."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Target:
    """A bound on how much faster than a reference the kernel must be.

    Attributes:
        reference: Name of the candidate that it is held against.
        ratio: Least ratio of the reference's time to ours; below 1 where being so much slower is allowed.
    """

    reference: str
    ratio: float


@dataclass(frozen=True)
class KernelRow:
    """One kernel at one size, with everything it is compared with in the same process.

    Attributes:
        name: Unique name of the row: kernel and size, such as "box_count 7, 512^3".
        ours: Name of the candidate that the targets are about.
        candidates: Functions of no arguments by name; results are waited for. The module that builds the row checks
            their results against each other before.
        count: Items that one call processes.
        unit: Name of an item: "voxel", "point", "pose".
        bytes_moved: Bytes that a call must move at least, 0 where memory is not the limit.
        targets: Ratios that must hold.
        max_ns: Largest time per item [ns]; 0 for none.
        temporary_bytes: Temporary memory of the compiled kernel (`memory_analysis`); None where it is not one call.
        max_temporary: Largest `temporary_bytes` per item; 0 for none.
        note: One line on how it was set up.
    """

    name: str
    ours: str
    candidates: Mapping[str, Callable[[], object]]
    count: int
    unit: str
    bytes_moved: float = 0.0
    targets: tuple[Target, ...] = field(default=())
    max_ns: float = 0.0
    temporary_bytes: int | None = None
    max_temporary: float = 0.0
    note: str = ""
