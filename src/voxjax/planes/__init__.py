"""voxjax.planes."""
