"""Poses that minimise residuals between maps, with derivatives of what the solution depends on.

`voxjax.refine` and `voxjax.refine_joint` are the verbs for maps; whoever brings terms of their own starts at
`solve_pose`. Everything here is pure functions of arrays, safe under jit, vmap and grad; what is decided on the host
(which voxels, which fields) is in `voxjax.refinement.maps.pair`.
"""

from .residuals.distance import Distances
from .residuals.losses import Loss
from .residuals.occupancy import Occupancies
from .residuals.pairs import CornerPairs, Prior
from .residuals.planes import NearestSurface, PointToPlane, Sample
from .residuals.terms import Level, PointTerm, Term
from .solve.covariance import pose_covariance
from .solve.joint import solve_joint
from .solve.joint_problem import JointProblem
from .solve.noise import implicit_covariance
from .solve.pose import RefinedPose, solve_pose
from .solve.problem import PoseProblem

__all__ = [
    "CornerPairs",
    "Distances",
    "JointProblem",
    "Level",
    "Loss",
    "NearestSurface",
    "Occupancies",
    "PointTerm",
    "PointToPlane",
    "PoseProblem",
    "Prior",
    "RefinedPose",
    "Sample",
    "Term",
    "implicit_covariance",
    "pose_covariance",
    "solve_joint",
    "solve_pose",
]
