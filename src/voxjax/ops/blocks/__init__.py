"""Sparse grids: blocks of 8 x 8 x 8 voxels with anything in them, and lists of occupied voxels.

No stage of the pipeline uses the blocks yet; this room is a door of its own for whoever counts at occupied voxels of
large, mostly empty grids. Start at `choice.box_count_at`, which chooses between dense counts and counts in blocks.
"""
