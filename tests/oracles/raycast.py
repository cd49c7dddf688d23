"""Which voxels rays cross and where rays meet boxes: plain NumPy twins, written from the definitions."""

import numpy as np


def crossed_by_clipping(start, end, shape):
    """Lengths of the segment inside each voxel of the grid, (x, y, z), by clipping it against every voxel."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).astype(np.float64)
    direction = np.asarray(end, np.float64) - np.asarray(start, np.float64)
    enter, leave = np.zeros(shape), np.ones(shape)
    for axis in range(3):
        low, high = index[..., axis] - start[axis], index[..., axis] + 1.0 - start[axis]
        if direction[axis] == 0.0:
            leave = np.where((low <= 0.0) & (high > 0.0), leave, -1.0)
            continue
        times = np.sort(np.stack([low, high]) / direction[axis], axis=0)
        enter, leave = np.maximum(enter, times[0]), np.minimum(leave, times[1])
    return (leave - enter) * np.linalg.norm(direction)


def range_to_boxes(start, direction, rotations, centres, half_sizes):
    """Distance along one ray to the nearest box surface, inf if none, by meeting each of the six faces."""
    best = np.inf
    for rotation, centre, half in zip(rotations, centres, half_sizes, strict=True):
        p, d = rotation.T @ (start - centre), rotation.T @ direction
        for axis in range(3):
            for side in (-1.0, 1.0):
                if d[axis] == 0.0:
                    continue
                t = (side * half[axis] - p[axis]) / d[axis]
                others = [a for a in range(3) if a != axis]
                on_face = all(abs(p[a] + t * d[a]) <= half[a] for a in others)
                if t > 0.0 and on_face:
                    best = min(best, t)
    return best
