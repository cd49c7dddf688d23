"""Poses that minimise residuals between maps, with derivatives of what the solution depends on.

On the host: `voxjax.refine` (file refine.py) and `voxjax.refine_joint` (file refine_joint.py) are the verbs,
`problems` makes problems of maps (which voxels, which fields), `outcome` holds what they give. On arrays, safe under
jit, vmap and grad: `residuals` (terms of the cost) and `solve` (solvers); this package has their names. Users start at
`voxjax.refine`, to which a `Term` of one's own is given as it is; whoever has arrays instead of maps at `solve_pose`.
"""

from .residuals.distance import Distances
from .residuals.known import CornerPairs, Prior
from .residuals.losses import Loss
from .residuals.occupancy import Occupancies
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
