"""Solvers of refinement by optimistix: levels, normal equations, implicit derivatives and covariances.

This package is pure functions of arrays, safe under jit, vmap and grad. Start at `pose.solve_pose`.
"""
