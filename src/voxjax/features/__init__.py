"""Corners of a map: voxel classes, clusters and intersections of three planes, observed or hidden.

This package is for `voxjax.detect_corners` and `voxjax.classify_voxels`. Start at `corners.detect_corners`.
"""
