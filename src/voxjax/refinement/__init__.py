"""Poses that minimise residuals between maps, with derivatives of what the solution depends on.

Everything here is pure functions of arrays, safe under jit, vmap and grad; what is decided on the host (which voxels,
which fields) is in `voxjax.registration.problem`.
"""
