"""Grids in other frames and sizes: rigid resampling, other voxel sizes, points and rays to grids.

This room is for fusion and for `VoxelGrid`. Start at `rigid.resample_rigid`; `interpolate` has the differentiable form.
"""
