"""voxjax.view."""
