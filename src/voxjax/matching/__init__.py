"""voxjax.matching."""
