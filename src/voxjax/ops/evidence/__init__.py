"""What one map says about another under a pose: hits, conflicts, nearest surfaces, alignment of many poses.

This room is for registration, where thousands of poses are scored. Start at `nearest.nearest_field`, the table that
all lookups share, then `scoring.score_poses` and `align.align_poses`.
"""
