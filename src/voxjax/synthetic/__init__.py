"""voxjax.synthetic."""
