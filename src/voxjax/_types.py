"""Codes of voxel states and the array alias used in all signatures."""

import jax
import numpy as np

Array = jax.Array | np.ndarray
"""Host or device array: every public function takes both."""

UNKNOWN = np.uint8(0)
FREE = np.uint8(1)
OCCUPIED = np.uint8(2)
