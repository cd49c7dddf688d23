"""Clouds of points for tests: rooms whose walls are sampled, and files of them."""

from pathlib import Path

import numpy as np


def write_cloud(path, points, kind="double"):
    """Write points to a binary `.ply` file, as "double" or "float"."""
    rows = np.asarray(points, {"double": "<f8", "float": "<f4"}[kind])
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    lines += [*(f"property {kind} {axis}" for axis in "xyz"), "end_header", ""]
    Path(path).write_bytes("\n".join(lines).encode() + rows.tobytes())


def room_points(spacing, *, sides=(60, 50, 30), seed=0):
    """Points thrown at the walls, floor and ceiling of a room: one for each square of that side [m] on the average.

    The room is so many spacings long, wide and high, and turned so that no wall lies along an axis.
    """
    rng = np.random.default_rng(seed)
    size = np.asarray(sides, float)
    area = np.array([size[1] * size[2], size[0] * size[2], size[0] * size[1]])
    axis = rng.choice(3, int(2 * area.sum()), p=area / area.sum())
    points = rng.uniform(0, 1, (len(axis), 3)) * size
    points[np.arange(len(axis)), axis] = rng.integers(0, 2, len(axis)) * size[axis]
    turn, _ = np.linalg.qr(np.array([[1.0, 0.4, -0.2], [-0.3, 1.0, 0.5], [0.2, -0.6, 1.0]]))
    return points @ turn.T * spacing
