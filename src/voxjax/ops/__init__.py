"""voxjax.ops."""
