"""What reading one file may take: memory in proportion to the file, and no more than there is.

The bytes of a file decide how much memory its reader asks for, so a file that is damaged, or made to do harm, could ask
for all of it. Every reader therefore names what it will take before it takes it. What a reader does is linear in the
bytes of the file and in the memory that was granted, so the budget bounds its time as well.
"""

import math
from typing import NamedTuple

from .._checks import InputError
from .._runtime.memory import GIGABYTE, available_memory, chosen_memory
from ..ops.resampling.lattice import MAX_VOXELS


class Budget(NamedTuple):
    """What reading one file may take.

    Attributes:
        size: Length of the file [byte].
        max_voxels: Largest grid, chosen by the caller; None for `MAX_VOXELS`, and for less from a small file. Grids in
            blocks have no other limit than the memory then.
    """

    size: int
    max_voxels: int | None = None

    @property
    def most_voxels(self) -> int:
        """Largest dense grid, whatever the memory."""
        return MAX_VOXELS if self.max_voxels is None else self.max_voxels

    def memory(self, *, least: int = 1 << 29, per_byte: int = 2048) -> tuple[float, str]:
        """Memory beside the file itself [byte], and where this number comes from: a main clause for a refusal.

        What `VOXJAX_MEMORY` allows, if it is set; else what is available, and without `max_voxels` no more than a file
        of this size can need. A real map takes 30 to 900 bytes of memory for a byte of its file. The densest archive
        holds 1032 bytes in one, an empty map of `least` voxels can be a file of 100 bytes.

        Args:
            least: What any file may take [byte].
            per_byte: What a file may take for each of its bytes [byte].
        """
        chosen, available = chosen_memory(), available_memory()
        # Whoever names a largest grid has said what the file may take; the machine's memory is the only bound then.
        justified = float(max(least, per_byte * self.size)) if self.max_voxels is None else math.inf
        # The user's word comes first; then the smaller of the two bounds is the one that the refusal has to name.
        if chosen is not None:
            return chosen, f"VOXJAX_MEMORY allows {chosen / GIGABYTE:.3g} GB"
        if available is not None and available < justified:
            return float(available), f"{available / GIGABYTE:.3g} GB are available"
        return justified, f"a file of {self.size:,} bytes may take {justified / GIGABYTE:.3g} GB"

    def check(self, need: int | float, what: str) -> None:
        """Raise if something needs more memory than the budget has.

        Args:
            need: Memory that it takes [byte].
            what: What needs it, the subject of the sentence.

        Raises:
            InputError: If that is too much.
        """
        excess = self.excess(need)
        if excess is not None:
            raise InputError(
                f"{what} {excess}; if the file is right, cut it to what is needed, or {self.memory_advice}"
            )

    def excess(self, need: int | float) -> str | None:
        """What is too much about a need of memory [byte], as the end of a main clause; None if the budget has it."""
        if need < 1 << 24:  # less than a process takes that reads maps: not worth the milliseconds of asking
            return None
        most, origin = self.memory()
        return f"needs about {need / GIGABYTE:.3g} GB of memory, and {origin}" if need > most else None

    @property
    def memory_advice(self) -> str:
        """How a user grants a file more memory, as an infinitive clause without its "to"."""
        return "set VOXJAX_MEMORY to the gigabytes that it may take"

    def check_grid(self, shape: tuple[int, ...], bytes_per_voxel: int, extra: int = 0) -> None:
        """Raise if a dense grid is too large.

        Args:
            shape: Number of voxels along x, y, z.
            bytes_per_voxel: What its arrays take together.
            extra: What else is held at the same time [byte].

        Raises:
            InputError: If it has more voxels or takes more memory than the budget has.
        """
        num_voxels, size = math.prod(shape), " x ".join(map(str, shape))
        limit = self.most_voxels
        if max(num_voxels, *shape, 0) > limit:  # an empty axis hides the others in the product
            raise InputError(
                f"the map spans {size} voxels, more than the limit of {limit:,}; "
                "cut the map, or raise max_voxels if there is memory for it"
            )
        self.check(num_voxels * bytes_per_voxel + extra, f"the map of {size} voxels")
