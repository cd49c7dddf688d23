"""Maps with known poses become one map: rules for states and log-odds, and a differentiable form.

This package is for `voxjax.fuse`. Start at `fuse.fuse`, then `rules` for what happens where maps disagree.
"""
