"""A room with one box on its floor, as a voxel map in any frame, with its corners from the drawing."""

import numpy as np

ROOM = np.asarray([30.0, 24.0, 20.0])
BOX_LOW, BOX_HIGH = np.asarray([12.0, 9.0, 0.0]), np.asarray([21.0, 17.0, 9.0])


def rotation(axis, angle):
    """Rodrigues' formula."""
    x, y, z = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    k = np.asarray([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k)


def outside_distance(points, low, high):
    """Signed distance to a box, positive outside."""
    q = np.maximum(low - points, points - high)
    return np.linalg.norm(np.maximum(q, 0.0), axis=-1) + np.minimum(q.max(axis=-1), 0.0)


def room_map(turn, shift=(0.3, -0.2, 0.4), thickness=0.6, noise=0.0, seed=0):
    """States of the room turned by `turn`, and the matrix and vector with p_map = turn @ p_room + vector [voxel]."""
    corners = np.stack(np.meshgrid(*[(0.0, e) for e in ROOM], indexing="ij"), axis=-1).reshape(-1, 3) @ turn.T
    vector = 4.0 - corners.min(axis=0) + np.asarray(shift)
    shape = np.ceil(corners.max(axis=0) + vector + 5).astype(int)
    centres = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), axis=-1).astype(np.float64)
    if noise:
        centres = centres + np.random.default_rng(seed).normal(0, noise, centres.shape)
    local = (centres - vector) @ turn
    free = np.minimum(-outside_distance(local, np.zeros(3), ROOM), outside_distance(local, BOX_LOW, BOX_HIGH))
    return np.where(np.abs(free) < thickness, 2, np.where(free > 0, 1, 0)).astype(np.uint8), vector


def true_corners():
    """Positions (16, 3) in the room's frame, normals into free space (16, 3, 3), number of convex edges (16,)."""
    position, normals, convexity = [], [], []
    for octant in np.ndindex(2, 2, 2):
        side = np.asarray(octant)
        position.append(side * ROOM)
        normals.append(np.diag(1.0 - 2.0 * side))
        convexity.append(0)
        position.append(np.where(side, BOX_HIGH, BOX_LOW))
        outward = 2.0 * side - 1.0
        outward[2] = 1.0
        normals.append(np.diag(outward))
        convexity.append(3 if side[2] else 1)
    return np.asarray(position), np.asarray(normals), np.asarray(convexity)
