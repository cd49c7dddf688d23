"""voxjax.fusion."""
