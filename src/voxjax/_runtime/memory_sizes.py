"""Sizes of memory as people write them: one reading for the option `--memory` and the variable `VOXJAX_MEMORY`.

Imports nothing heavy: arguments of the command line are read before NumPy is.
"""

import math
import re


def gigabytes_of(text: str) -> float | None:
    """Gigabytes (10**9 bytes) that a text means: a number, then a unit or none, in any case, with or without a blank.

    Units are G or GB, M or MB, and GiB and MiB for powers of 1024; a number alone counts gigabytes.

    Returns:
        The number, above 0 and finite; None for any other text.
    """
    units = {"": 1.0, "g": 1.0, "gb": 1.0, "m": 1e-3, "mb": 1e-3, "gib": 1024**3 / 1e9, "mib": 1024**2 / 1e9}
    # No name of a number, such as "inf" or "nan", has its letters in this pattern.
    match = re.fullmatch(r"\s*\+?(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+)\s*([a-z]*)\s*", text.lower(), re.ASCII)
    if match is None or match[2] not in units:
        return None
    size = float(match[1]) * units[match[2]]
    return size if 0.0 < size < math.inf else None
