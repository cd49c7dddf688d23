"""Normals, curvature and free sides of listed occupied voxels from the voxels around each of them.

This room is for planes, corners and `maps.prepared`. Start at `moments.surface_moments`.
"""
