"""voxjax.pipeline."""
