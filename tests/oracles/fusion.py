"""The fusion rules, one voxel after the other."""

import numpy as np


def paper(states: list[int], covered: list[bool]) -> int:
    """Occupied if any map says so, free if all maps that reach the voxel say so, otherwise unknown."""
    reaching = [state for state, is_covered in zip(states, covered, strict=True) if is_covered]
    if 2 in reaching:
        return 2
    return 1 if reaching and all(state == 1 for state in reaching) else 0


def keep(states: list[int]) -> int:
    """Occupied if any map says so, else free if any map says so."""
    return 2 if 2 in states else 1 if 1 in states else 0


def log_odds(states: list[int], values: list[float]) -> tuple[int, float]:
    """Sum of the evidence of the maps that know the voxel, within OctoMap's limits."""
    known = [value for state, value in zip(states, values, strict=True) if state]
    total = float(np.clip(sum(known), np.log(0.1192 / 0.8808), np.log(0.971 / 0.029)))
    return (0, 0.0) if not known else (2 if total >= 0 else 1, total)
