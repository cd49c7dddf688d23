"""From N maps to the residuals between them, in tables that all pairs read."""

import itertools
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..._types import Array
from ...maps.prepared import PreparedMap
from ..residuals.losses import Loss
from ..residuals.terms import Term
from ..solve.joint_problem import JointProblem, edges_of
from ..solve.problem import PoseProblem
from .joint_pairs import Pair
from .joint_tables import in_common_tables
from .pair import checked_residuals, terms_between
from .parts import Points, Target, centre_of, check_num_points, points_of, target_of
from .views import MapView, as_view


class JointMaps(NamedTuple):
    """What residuals need of N maps; by number, of those that are in a pair.

    Attributes:
        targets: Maps as points are held against them, in common tables.
        points: Points of each map.
        centroids: Centroids of all maps, 0 for those that are in no pair [m].
        radii: About those of the maps, 1 of those that are in no pair [m].
    """

    targets: dict[int, Target]
    points: dict[int, Points]
    centroids: Float[Array, "maps 3"]
    radii: Float[Array, "maps"]

    def problem(
        self,
        pairs: Sequence[Pair],
        is_fixed: Bool[Array, "maps"],
        *,
        residuals: Mapping[str, float],
        terms: Mapping[Pair, Sequence[Term]],
        loss: Loss,
    ) -> JointProblem:
        """Residuals of kinds that the maps were made for, and terms of single pairs; see `joint_problem`."""

        def of_pair(a: int, b: int) -> PoseProblem:
            # Pairs count both ways, because neither map is the truth: errors of the planes of both average out.
            ways = [(self.targets[a], self.points[b]), (self.targets[b], self.points[a])]
            between = terms_between(ways, residuals, loss)
            return PoseProblem((*between, *terms.get((a, b), ())), self.centroids[b], self.radii[b])

        # Pairs of equal shapes are stacked, so that the kernel does not grow with their number.
        edges = edges_of([(a, b, of_pair(a, b)) for a, b in pairs])
        return JointProblem(edges, self.centroids, self.radii, jnp.asarray(is_fixed))


def joint_maps(
    maps: Sequence[MapView | PreparedMap | None],
    pairs: Sequence[Pair],
    kinds: Collection[str],
    num_points: int,
) -> JointMaps:
    """What residuals of some kinds need of the maps that are in pairs.

    Args:
        maps: None for maps without an occupied voxel, which are in no pair; those with log-odds all of one dtype.
        pairs: Numbers of the maps that are held against each other, at least one pair.
        kinds: Kinds of residuals and their weights.
        num_points: Voxels of each sample.

    Raises:
        InputError: If the maps are too large for one table, or `num_points` is out of its range.
    """
    check_num_points(num_points)
    # Points and tables are made once a map, however many pairs it is in.
    used = set(itertools.chain(*pairs))
    views = {
        number: as_view(given) for number, given in enumerate(maps) if given is not None and number in used
    }
    targets = in_common_tables(
        [target_of(view, kinds) for view in views.values()], [view.prepared for view in views.values()]
    )
    # Views of log-odds have their dtype, which all share: float64 where gradients are checked.
    dtype = next(iter(views.values())).anchors.dtype
    # Maps without a pair keep numbers that do no harm: a radius of 0 would be divided by.
    centroids, radii = np.zeros((len(maps), 3), dtype), np.ones(len(maps), dtype)
    for number, view in views.items():
        centroids[number], radii[number] = centre_of(view, num_points)
    return JointMaps(
        dict(zip(views, targets, strict=True)),
        {number: points_of(view, kinds, num_points) for number, view in views.items()},
        jnp.asarray(centroids),
        jnp.asarray(radii),
    )


def joint_problem(
    maps: Sequence[MapView | PreparedMap | None],
    pairs: Sequence[Pair],
    is_fixed: Bool[Array, "maps"],
    *,
    residuals: Mapping[str, float] | None = None,
    terms: Mapping[Pair, Sequence[Term]] | None = None,
    num_points: int = 2048,
    loss: Loss = "geman_mcclure",
) -> JointProblem:
    """Points of both maps of each pair against the other map, each way with half of the weight.

    Args:
        maps: Maps as `joint_maps` takes them.
        pairs: Numbers of the maps that are held against each other, at least one pair.
        is_fixed: Which maps keep their pose.
        residuals: Kinds and their weights, as of `pose_problem`.
        terms: Further residuals of single pairs, by the pairs, about `T_a_b`.
        num_points: Voxels of each sample.
        loss: What a large offset costs.

    Raises:
        InputError: If a kind is not known or a weight not positive, or the maps are too large for one table.
    """
    kinds = checked_residuals(residuals)
    made = joint_maps(maps, pairs, kinds, num_points)
    return made.problem(pairs, is_fixed, residuals=kinds, terms=terms or {}, loss=loss)
