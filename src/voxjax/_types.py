"""Codes of voxel states and the array alias used in all signatures."""

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

Array = jax.Array | np.ndarray
"""Host or device array: every public function takes both."""

UNKNOWN = np.uint8(0)
FREE = np.uint8(1)
OCCUPIED = np.uint8(2)

States = UInt8[Array, "x y z"]
LogOdds = Float32[Array, "x y z"]
IsOccupied = Bool[Array, "x y z"]
Points = Float32[Array, "n 3"]
Pose = Float32[Array, "4 4"]
Indices = Int32[Array, "n 3"]
