"""Solids of generated worlds: upright prisms over convex quadrilaterals, and the rays that meet them.

Walls, floors, furniture and people are all such prisms, so one test serves them all.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float32

from .._types import Array


class Prisms(NamedTuple):
    """Upright prisms.

    Attributes:
        footprint: (n, 4, 2) [m], the vertices counterclockwise seen from above.
        z_range: (n, 2) [m], bottom and top.
        kind: (n,) names of at most nine letters: "wall", "floor", "ceiling", "furniture", "door", "person", "tree" ...
    """

    footprint: np.ndarray
    z_range: np.ndarray
    kind: np.ndarray

    @property
    def side_normals(self) -> np.ndarray:
        """Outward unit normals of the sides, (n, 4, 2); side i goes from vertex i to vertex i + 1."""
        along = np.roll(self.footprint, -1, axis=1) - self.footprint
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        return np.stack([along[..., 1], -along[..., 0]], axis=-1)

    @property
    def side_offsets(self) -> np.ndarray:
        """Offsets of the sides, (n, 4) [m]: a point is inside where normal @ p <= offset for all sides."""
        return np.einsum("nki,nki->nk", self.side_normals, self.footprint)

    def within(self, place: np.ndarray, radius: float) -> "Prisms":
        """Those prisms whose bounding box comes as near to a place (3,) as `radius` [m]."""
        low = np.concatenate([self.footprint.min(axis=1), self.z_range[:, :1]], axis=1)
        high = np.concatenate([self.footprint.max(axis=1), self.z_range[:, 1:]], axis=1)
        gap = np.maximum(np.maximum(low - place, place - high), 0.0)
        is_near = np.einsum("nk,nk->n", gap, gap) <= radius * radius
        return Prisms(*(array[is_near] for array in self))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Largest signed distance to the face planes of each prism, (m, n) [m]; below 0 inside.

        At most the distance to the prism, and equal to it beside a face.
        """
        sides = np.einsum("nki,mi->mnk", self.side_normals, points[:, :2]) - self.side_offsets
        z = points[:, 2:]
        ends = np.maximum(self.z_range[:, 0] - z, z - self.z_range[:, 1])
        return np.maximum(sides.max(axis=-1), ends)


def make_prisms(parts: Sequence[tuple[np.ndarray, float, float, str]]) -> Prisms:
    """Collect (footprint, bottom, top, kind) into `Prisms`."""
    return Prisms(
        np.asarray([p[0] for p in parts], np.float64).reshape(-1, 4, 2),
        np.asarray([p[1:3] for p in parts], np.float64).reshape(-1, 2),
        np.asarray([p[3] for p in parts], dtype="U9"),
    )


def join_prisms(*groups: Prisms) -> Prisms:
    """All prisms of the groups, in order."""
    return Prisms(*(np.concatenate(arrays) for arrays in zip(*groups, strict=True)))


def rectangle(centre: np.ndarray, length: float, width: float, yaw: float) -> np.ndarray:
    """Vertices (4, 2) of a rectangle, `length` along the direction `yaw` [rad], counterclockwise."""
    u = np.asarray([np.cos(yaw), np.sin(yaw)])
    v = np.asarray([-u[1], u[0]])
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return np.asarray([centre + 0.5 * (a * length * u + b * width * v) for a, b in signs])


@jax.jit
def cast_rays(
    origin: Float32[Array, "3"],
    directions: Float32[Array, "n 3"],
    side_normals: Float32[Array, "p 4 2"],
    side_offsets: Float32[Array, "p 4"],
    z_range: Float32[Array, "p 2"],
    mask: Bool[Array, " p"],
) -> Float32[Array, " n"]:
    """Distance to the nearest prism along rays from one origin.

    A ray is inside a convex solid between the last face that it enters through and the first that it leaves
    through. Prisms that hold the origin are not seen.

    Args:
        origin: Start of all rays [m].
        directions: Unit vectors.
        side_normals: Outward unit normals of the sides.
        side_offsets: Offsets of the sides [m].
        z_range: Bottom and top of each prism [m].
        mask: Rows that hold a prism.

    Returns:
        Distances [m], inf where a ray meets nothing.
    """
    dx, dy, dz = directions[:, 0], directions[:, 1], directions[:, 2]
    # A ray parallel to a face crosses its plane far away, on the side where it lies.
    tiny = jnp.float32(1e-9)

    def nonzero(speed: Array) -> jax.Array:
        return jnp.where(jnp.abs(speed) < tiny, tiny, speed)

    inverse_dz = jnp.float32(1.0) / nonzero(dz)

    def meet(nearest: jax.Array, prism: tuple) -> tuple[jax.Array, None]:
        normals, offsets, heights, exists = prism
        to_bottom = (heights[0] - origin[2]) * inverse_dz
        to_top = (heights[1] - origin[2]) * inverse_dz
        enter, leave = jnp.minimum(to_bottom, to_top), jnp.maximum(to_bottom, to_top)
        for side in range(4):
            speed = nonzero(dx * normals[side, 0] + dy * normals[side, 1])
            gap = offsets[side] - normals[side, 0] * origin[0] - normals[side, 1] * origin[1]
            time = gap / speed
            enter = jnp.where(speed < 0, jnp.maximum(enter, time), enter)
            leave = jnp.where(speed > 0, jnp.minimum(leave, time), leave)
        # A solid behind the origin has a negative way in; so has one that holds the origin.
        is_met = exists & (enter < leave) & (enter > 0)
        return jnp.where(is_met, jnp.minimum(nearest, enter), nearest), None

    # One prism after the other, so that there is never an array of all rays times all prisms.
    nothing = jnp.full(directions.shape[:1], jnp.inf, jnp.float32)
    return jax.lax.scan(meet, nothing, (side_normals, side_offsets, z_range, mask))[0]
