"""voxjax.io."""
