"""Problems of refinement from maps: which voxels take part, which fields they meet, and starts that are far off.

This package is the host's side of `voxjax.refine`; it knows grids, which `residuals` and `solve` do not. Start at
`pair.pose_problem`.
"""
