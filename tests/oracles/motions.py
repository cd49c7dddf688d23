"""Rigid motions for tests, by SciPy; import nothing of the library."""

import itertools

import numpy as np
from scipy.spatial.transform import Rotation


def pose_of(rotation=None, translation=(0.0, 0.0, 0.0)):
    """A pose, float64 (4, 4), of a rotation, the identity if None, and a translation."""
    T = np.eye(4)
    T[:3, :3] = np.eye(3) if rotation is None else rotation
    T[:3, 3] = translation
    return T


def turned(axes, angles, translation=(0.0, 0.0, 0.0), *, degrees=False):
    """A pose of Euler angles, as SciPy names their axes, and a translation."""
    return pose_of(Rotation.from_euler(axes, angles, degrees=degrees).as_matrix(), translation)


def random_rotation(rng):
    """A rotation (3, 3), all of them as likely."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def random_pose(rng, *, metres=5.0, degrees=180.0):
    """A pose, float64 (4, 4), with a translation up to `metres` an axis and an angle up to `degrees`."""
    axis = rng.normal(size=3)
    rotvec = axis / np.linalg.norm(axis) * np.radians(rng.uniform(0, degrees))
    return pose_of(Rotation.from_rotvec(rotvec).as_matrix(), rng.uniform(-metres, metres, 3))


def moved(T, points):
    """Points under a pose."""
    return np.asarray(points, np.float64) @ T[:3, :3].T + T[:3, 3]


def pose_error(T, T_true, point):
    """Angle [degrees], and distance [m] at the image of a point, between two poses."""
    T, T_true = np.asarray(T, np.float64), np.asarray(T_true, np.float64)
    angle = Rotation.from_matrix(T[:3, :3].T @ T_true[:3, :3]).magnitude()
    gap = moved(T, np.atleast_2d(point)) - moved(T_true, np.atleast_2d(point))
    return float(np.degrees(angle)), float(np.linalg.norm(gap))


def nudged(T, point, rng, *, metres, degrees):
    """A pose near `T`: turned by `degrees` about the image of `point` and shifted by `metres`."""
    axis, shift = rng.normal(size=3), rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(degrees)).as_matrix()
    image = moved(T, np.atleast_2d(point))[0] + shift / np.linalg.norm(shift) * metres
    rotation = turn @ T[:3, :3]
    return pose_of(rotation, image - rotation @ np.asarray(point, np.float64))


def cube_rotations():
    """The 24 rotations (3, 3) of the cube."""
    turns = (
        np.eye(3)[list(axes)] * np.array(signs)[:, None]
        for axes in itertools.permutations(range(3))
        for signs in itertools.product((1, -1), repeat=3)
    )
    return [turn for turn in turns if np.linalg.det(turn) > 0]
