"""voxjax.cli."""
