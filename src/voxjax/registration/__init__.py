"""voxjax.registration."""
