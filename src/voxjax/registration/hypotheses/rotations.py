"""Rotation hypotheses from the normals of two maps: directions that both share, sharpened on all normals.

Buildings have few directions. Two of them in each map fix a rotation up to signs; a rotation is kept when the signed
normals of the whole surfaces agree under it.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy.spatial.transform import Rotation

from ..._runtime.pieces import over_pieces
from ..._runtime.precision import in_full_precision
from ..._runtime.programs import kept_program
from ..._types import Array
from .distinct import distinct_rows
from .settings import RotationConfig, SourceConfig


def _frame(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Right-handed orthonormal frame, as columns, symmetric in the two directions."""
    # Sum and difference are at right angles for unit vectors; an error of the angle between them spreads to
    # both alike.
    s, d = first + second, first - second
    s, d = s / np.linalg.norm(s), d / np.linalg.norm(d)
    return np.stack([s, d, np.cross(s, d)], axis=1)


def pair_rotations(
    directions_a: np.ndarray,
    directions_b: np.ndarray,
    *,
    angle_tolerance: float = RotationConfig.angle_tolerance,
    min_angle: float = RotationConfig.min_angle,
) -> np.ndarray:
    """All rotations that map two directions of b onto two of a, up to signs, float64 (k, 3, 3).

    Args:
        directions_a: (m, 3) unit rows.
        directions_b: (n, 3) unit rows.
        angle_tolerance: Largest difference of the angle between the two directions in each map [deg].
        min_angle: Directions of a nearer to each other than this propose nothing [deg].
    """
    rotations = []
    pairs_b = [(k, m) for k in range(len(directions_b)) for m in range(len(directions_b)) if k != m]
    for i in range(len(directions_a)):
        for j in range(i + 1, len(directions_a)):
            first, second = directions_a[i], directions_a[j]
            cos_a = float(first @ second)
            # Directions that are nearly parallel fix the rotation about themselves badly.
            if abs(cos_a) > np.cos(np.radians(min_angle)):
                continue
            frame_a = _frame(first, second)
            for k, m in pairs_b:
                # Dominant directions have no sign: either of the two may point the other way in the other map.
                for sign in (1.0, -1.0):
                    cos_b = sign * float(directions_b[k] @ directions_b[m])
                    if abs(np.arccos(np.clip(cos_a, -1, 1)) - np.arccos(np.clip(cos_b, -1, 1))) > np.radians(
                        angle_tolerance
                    ):
                        continue
                    # The relative sign is settled; both directions may still be turned over together.
                    for flip in (1.0, -1.0):
                        frame_b = _frame(flip * directions_b[k], flip * sign * directions_b[m])
                        rotations.append(frame_a @ frame_b.T)
    return np.reshape(np.asarray(rotations), (-1, 3, 3))


def turned_about(
    direction_a: Float[np.ndarray, "3"], direction_b: Float[np.ndarray, "3"], num_turns: int
) -> Float[np.ndarray, "k 3 3"]:
    """Rotations that map a direction of b onto one of a, up to its sign, with evenly spread turns about it.

    Args:
        direction_a: Unit vector.
        direction_b: Unit vector.
        num_turns: Turns for each sign.
    """
    turns = Rotation.from_rotvec(np.outer(np.arange(num_turns) * (2.0 * np.pi / num_turns), direction_a))
    first = [_frame_along(direction_a) @ _frame_along(sign * direction_b).T for sign in (1.0, -1.0)]
    return np.concatenate([(turns * Rotation.from_matrix(rotation)).as_matrix() for rotation in first])


def _frame_along(direction: np.ndarray) -> np.ndarray:
    """Right-handed orthonormal frame, as columns, of which a direction is the first."""
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    return np.stack([direction, across, np.cross(direction, across)], axis=1)


@kept_program
@partial(jax.jit, static_argnames=("num_steps", "concentration"))
@in_full_precision
def sharpen_rotations(
    normals_a: Float32[Array, "n 3"],
    normals_b: Float32[Array, "m 3"],
    rotations: Float32[Array, "k 3 3"],
    count: Int32[Array, ""] | np.int32,
    is_signed: Bool[Array, ""] | bool,
    *,
    num_steps: int = 6,
    concentration: float = RotationConfig.concentration,
) -> tuple[Float32[Array, "k 3 3"], Float32[Array, "k"]]:
    """Climb from each rotation to the nearest mode of the agreement of the normals.

    Each step solves the orthogonal Procrustes problem with the kernel weights of the step before.

    Args:
        normals_a: Unit normals of a.
        normals_b: Unit normals of b.
        rotations: Starts, b into a.
        count: Number of starts that are sharpened; the others are left as they are.
        is_signed: Whether the sign of the normals means something in both maps.
        num_steps: Fixed number of steps.
        concentration: k of the kernel exp(k (cos - 1)) between normals.

    Returns:
        Rotations and their agreement: the mean kernel value over all pairs of normals.
    """

    def kernel(rotation: Array) -> tuple[Array, Array]:
        cosine = normals_a @ (normals_b @ rotation.T).T
        # Where signs mean nothing, the nearer of a normal and its opposite counts.
        sign = jnp.where(jnp.asarray(is_signed) | (cosine >= 0), 1.0, -1.0).astype(jnp.float32)
        return jnp.exp(concentration * (cosine * sign - 1.0)), sign

    def climb(rotation: Array, _: object) -> tuple[Array, None]:
        weight, sign = kernel(rotation)
        # The share of the start keeps the problem regular where hardly a normal weighs anything. Not
        # `rigid.nearest_rotation`, whose last bits differ: which of many nearly equal candidates are searched depends
        # on them.
        u, _, vt = jnp.linalg.svd(normals_a.T @ (weight * sign) @ normals_b + 1e-6 * rotation)
        det = jnp.linalg.det(u @ vt)
        return u @ (vt * jnp.stack([jnp.ones_like(det), jnp.ones_like(det), det])[:, None]), None

    def sharpen(i: Array, found: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        rotation = jax.lax.scan(climb, found[0][i], None, length=num_steps)[0]
        agreement = jnp.mean(kernel(rotation)[0], dtype=jnp.float32)
        return found[0].at[i].set(rotation), found[1].at[i].set(agreement)

    start = jnp.asarray(rotations), jnp.zeros(rotations.shape[0], jnp.float32)
    # A loop ends at `count`, where a batch would go through the padding too.
    return jax.lax.fori_loop(0, count, sharpen, start)


def rotation_hypotheses(
    samples_a: Float[np.ndarray, "n 3"],
    samples_b: Float[np.ndarray, "m 3"],
    directions_a: np.ndarray,
    directions_b: np.ndarray,
    *,
    is_signed: bool,
    is_free_to_turn: bool = False,
    max_lean: float | None = None,
    max_rotations: int = SourceConfig.max_rotations,
    settings: RotationConfig | None = None,
) -> tuple[Float[np.ndarray, "k 3 3"], np.ndarray]:
    """Distinct rotations of b into a, by agreement of the normals, best first.

    Args:
        samples_a: Unit normals of a, weighted by how often they occur (`draw_rows`).
        samples_b: Unit normals of b, drawn alike.
        directions_a: Dominant directions of a, (p, 3).
        directions_b: Dominant directions of b, (q, 3).
        is_signed: Whether the normals point into free space in both maps.
        is_free_to_turn: Try all turns about the strongest directions, too: nothing else fixes a turn about them.
        max_lean: Keep only rotations that tilt the vertical by less than this [deg]; None keeps all.
        max_rotations: Largest number of rotations.
        settings: How rotations are found; None for the defaults.

    Returns:
        float32 (k, 3, 3) and the agreement of each.
    """
    chosen = RotationConfig() if settings is None else settings
    apart = chosen.distinct_degrees
    seeds = pair_rotations(
        directions_a, directions_b, angle_tolerance=chosen.angle_tolerance, min_angle=chosen.min_angle
    )
    if is_free_to_turn and len(directions_a) and len(directions_b):
        seeds = np.concatenate([seeds, turned_about(directions_a[0], directions_b[0], chosen.num_turns)])
    if max_lean is not None:
        # Rotations that cannot be are left out before they take the time, and the places, of those that can.
        seeds = seeds[seeds[:, 2, 2] > np.cos(np.radians(max_lean))]
    if len(seeds) == 0:
        return np.zeros((0, 3, 3), np.float32), np.zeros(0)
    # Seeds have no scores yet, so the first of alike ones stays: directions come strongest first.
    seeds = seeds[distinct_rows(seeds, degrees=apart, max_count=chosen.max_seeds)]
    stride, kernel = chosen.rough_stride, chosen.concentration
    # Seeds are many and most climb to the same few rotations, which some of the normals are enough to tell.
    rough, agreement = _sharpen(
        samples_a[::stride], samples_b[::stride], seeds, is_signed, chosen.num_rough_steps, kernel
    )
    # What the rough rotations are short of may still bring two of them together: they are told apart more finely.
    rough = rough[distinct_rows(rough, scores=agreement, degrees=apart / 2, max_count=2 * max_rotations)]
    sharp, agreement = _sharpen(samples_a, samples_b, rough, is_signed, chosen.num_fine_steps, kernel)
    kept = distinct_rows(sharp, scores=agreement, degrees=apart, max_count=max_rotations)
    return sharp[kept], agreement[kept]


def _sharpen(
    samples_a: np.ndarray,
    samples_b: np.ndarray,
    rotations: np.ndarray,
    is_signed: bool,
    num_steps: int,
    concentration: float,
) -> tuple[np.ndarray, np.ndarray]:
    """`sharpen_rotations` of any number of rotations, in groups of one size, side by side."""

    def sharpen(some: np.ndarray, count: np.int32) -> tuple[Array, Array]:
        return sharpen_rotations(
            samples_a, samples_b, some, count, is_signed, num_steps=num_steps, concentration=concentration
        )

    sharp, agreement = over_pieces(sharpen, [rotations.astype(np.float32)], size=32)
    return sharp, agreement.astype(np.float64)
