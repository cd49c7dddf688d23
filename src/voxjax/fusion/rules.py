"""What a voxel becomes when several maps see it: pure functions over stacked maps, the first axis.

All rules are commutative, that of log-odds up to rounding where there are three maps or more. "paper" and "keep" are
idempotent and associative too (a fused map covers what its parts cover), so fusing N maps at once equals fusing them
one after another. The log-odds rule adds evidence: a map fused with itself becomes surer, on purpose.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Float32, UInt8

from .._checks import check_choice
from .._types import FREE, OCCUPIED, UNKNOWN, Array
from ..grid import VoxelGrid
from ..io.octomap import LOG_ODDS_FREE, LOG_ODDS_OCCUPIED

RULES = ("paper", "keep", "log_odds")


def chosen_rule(rule: str | None, grids: Sequence[VoxelGrid]) -> str:
    """The rule that some maps are fused by.

    Args:
        rule: One of `RULES`; None for "log_odds" where all maps have log-odds, else "keep".
        grids: The maps.

    Raises:
        InputError: If there is no such rule.
    """
    # States alone do not say how sure a map is, so evidence is added only where all maps have it.
    if rule is None:
        return "log_odds" if all(grid.has_log_odds for grid in grids) else "keep"
    check_choice("rule", rule, RULES)
    return rule


@jax.jit
def fuse_paper(
    states: UInt8[Array, "maps *voxels"], is_covered: Bool[Array, "maps *voxels"]
) -> UInt8[Array, "*voxels"]:
    """The fusion rule of the paper (IV.D).

    In the overlapping area a voxel is occupied if it is occupied in any map, free if it is free in every
    map, and otherwise unknown. The overlapping area is the volume that the maps' boxes share, not the
    voxels that both know: among those "otherwise" could never happen. What one map left unknown therefore
    becomes unknown unless the other saw it occupied. Where only one map reaches, the paper is silent and
    that map's state is kept.

    Args:
        states: 0 unknown, 1 free, 2 occupied.
        is_covered: Whether a voxel lies within a map's box.

    Returns:
        States of the fused map.
    """
    is_occupied = jnp.any((states == OCCUPIED) & is_covered, axis=0)
    all_free = jnp.all((states == FREE) | ~is_covered, axis=0) & jnp.any(is_covered, axis=0)
    return jnp.where(is_occupied, OCCUPIED, jnp.where(all_free, FREE, UNKNOWN))


@jax.jit
def fuse_keep(states: UInt8[Array, "maps *voxels"]) -> UInt8[Array, "*voxels"]:
    """Keep what any map knows: occupied beats free, free beats unknown.

    Args:
        states: 0 unknown, 1 free, 2 occupied: the codes are ordered, so the rule is the maximum.

    Returns:
        States of the fused map.
    """
    return jnp.max(states, axis=0)


@jax.jit
def fuse_log_odds(
    states: UInt8[Array, "maps *voxels"], log_odds: Float[Array, "maps *voxels"]
) -> tuple[UInt8[Array, "*voxels"], Float[Array, "*voxels"]]:
    """Add the log-odds of independent maps, within OctoMap's limits -2.0 and 3.51.

    Commutative for two maps and, up to the limits and rounding, for more; likewise associative; not idempotent.

    Args:
        states: 0 unknown, 1 free, 2 occupied; unknown voxels add nothing.
        log_odds: Evidence that each voxel is occupied.

    Returns:
        States (occupied where the sum is 0 or more, as OctoMap has it) and log-odds of the fused map, 0 where
        no map knows anything.
    """
    # What a map has for the log-odds of unknown voxels may be anything.
    is_known = states != UNKNOWN
    zero = jnp.zeros((), log_odds.dtype)
    total = jnp.sum(jnp.where(is_known, log_odds, zero), axis=0, dtype=log_odds.dtype)
    limits = (jnp.asarray(limit, log_odds.dtype) for limit in (LOG_ODDS_FREE, LOG_ODDS_OCCUPIED))
    # The limits keep evidence that can still be outvoted: without them, a sum over many maps could hardly
    # change any more.
    total = jnp.clip(total, *limits)
    known_state = jnp.where(total >= zero, OCCUPIED, FREE)
    return jnp.where(jnp.any(is_known, axis=0), known_state, UNKNOWN), total


@jax.jit
def log_odds_of_states(states: UInt8[Array, "*voxels"]) -> Float32[Array, "*voxels"]:
    """Log-odds of one observation, for maps without probabilities: 0.85 occupied, -0.4 free, 0 unknown."""
    # OctoMap counts one hit as a probability of 0.7 and one miss as 0.4; how sure such a map is, nobody knows.
    values = jnp.asarray([0.0, -0.4, 0.85], jnp.float32)
    return values[states.astype(jnp.int32)]
