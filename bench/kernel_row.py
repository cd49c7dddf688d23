"""What one row of `python -m bench kernels` measures, and against what."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Target:
    """How much faster than a reference the kernel must be.

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
        name: Of the row: kernel and size, unique, such as "box_count 7, 512^3".
        ours: Name of the candidate that the targets are about.
        candidates: What to call, by name; results are waited for. Results are checked against each other before the
            row is built, by the module that builds it.
        count: Items that one call processes.
        unit: What an item is: "voxel", "point", "pose".
        bytes_moved: Bytes that a call must move at least, 0 where memory is not the limit.
        targets: What must hold.
        max_ns: Largest time per item [ns]; 0 for none.
        temporary_bytes: Of the compiled kernel (`memory_analysis`); None where it is not one compiled call.
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
