"""Poses that minimise residuals between maps, with derivatives of what the solution depends on.

Everything here is pure functions of arrays, safe under jit, vmap and grad; what is decided on the host (which voxels,
which fields) is in `voxjax.registration.problem`.
"""

from .covariance import pose_covariance
from .distance import Distances
from .joint import solve_joint
from .joint_problem import JointProblem
from .losses import Loss
from .noise import implicit_covariance
from .occupancy import Occupancies
from .pairs import CornerPairs, Prior
from .planes import Planes, Sample, Surface
from .pose import RefinedPose, solve_pose
from .problem import PoseProblem
from .terms import Level, PointTerm, Term

__all__ = [
    "CornerPairs",
    "Distances",
    "JointProblem",
    "Level",
    "Loss",
    "Occupancies",
    "Planes",
    "PointTerm",
    "PoseProblem",
    "Prior",
    "RefinedPose",
    "Sample",
    "Surface",
    "Term",
    "implicit_covariance",
    "pose_covariance",
    "solve_joint",
    "solve_pose",
]
