"""voxjax.features."""
