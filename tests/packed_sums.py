"""Sums over the ball of a window, from packed states, as the kernels of surfaces take them."""

import jax
import numpy as np

from voxjax.ops.surface.ball_sums import window_sums
from voxjax.ops.surface.packed_states import PackedStates


def packed_sums(states, index, size, margin, pack):
    packed = PackedStates(*(jax.device_put(a) for a in pack(states, margin=margin)))

    @jax.jit
    def summed(packed, voxels):
        group, shift = packed.place(voxels, margin=margin)
        return window_sums(packed, group, shift + np.uint32(margin - size // 2), size=size)

    return np.asarray(summed(packed, index.T))
