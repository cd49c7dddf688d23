"""All hypotheses of a pair, from all sources, with the source of each."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..._runtime.threads import spread
from .corners import frame_poses, subgraph_poses
from .descriptors import descriptor_hypotheses
from .exhaustive import exhaustive_hypotheses, upright_frame
from .map_features import MapFeatures
from .ranking import distinct_poses, rank_poses
from .rotations import rotation_hypotheses

MAX_FRAME_POSES = 256
"""Corner frames that go on to the common ranking, after their own."""

UPRIGHT_COSINE = np.cos(np.radians(8.0))
"""Maps that are gravity aligned may still lean by so much against each other."""


class Proposals(NamedTuple):
    """Candidate poses and where each comes from.

    Attributes:
        poses: float32 (k, 4, 4) `T_a_b`.
        sources: One name a pose.
    """

    poses: Float[np.ndarray, "k 4 4"]
    sources: tuple[str, ...]


class ProposalCollector:
    """Gathers poses source by source; times each."""

    def __init__(
        self,
        a: MapFeatures,
        b: MapFeatures,
        *,
        gravity_aligned: bool,
        near: tuple[np.ndarray, float, float] | None = None,
    ):
        """Start without poses; of all poses only those near a guess count: (guess, metres, radians)."""
        self._a, self._b = a, b
        self._near = near
        self._gravity_aligned = gravity_aligned
        self._poses: list[np.ndarray] = []
        self._sources: list[str] = []
        self.stats: dict = {"num_associations": 0, "clique_size": 0, "num_hypotheses": 0}
        self.seconds: dict = {}

    def _add(self, poses: np.ndarray, sources: list[str]) -> None:
        is_allowed = self._allowed(poses)
        poses = poses[is_allowed]
        sources = [name for name, keep in zip(sources, is_allowed, strict=True) if keep]
        self._poses.append(poses.astype(np.float32))
        self._sources.extend(sources)

    def _allowed(self, poses: np.ndarray) -> np.ndarray:
        """Whether each pose is upright, where it must be, and near the guess."""
        is_allowed = np.ones(len(poses), bool)
        if self._gravity_aligned:
            is_allowed &= poses[:, 2, 2] > UPRIGHT_COSINE
        if self._near is not None:
            guess, metres, radians = self._near
            change = poses - guess[None]
            offset = change[:, :3, :3] @ np.asarray(self._b.prepared.centroid) + change[:, :3, 3]
            trace = np.einsum("kij,ij->k", poses[:, :3, :3], guess[:3, :3])
            is_allowed &= np.linalg.norm(offset, axis=1) <= metres
            is_allowed &= trace >= 1.0 + 2.0 * np.cos(min(radians, np.pi))
        return is_allowed

    def _timed(self, name: str, propose: Callable[[], None]) -> None:
        start = time.perf_counter()
        propose()
        self.seconds[name] = time.perf_counter() - start

    def add_guess(self, T_a_b: np.ndarray) -> None:
        """Add a pose from outside."""
        self._add(T_a_b[None], ["guess"])

    def add_corner_frames(self) -> None:
        """Add the best poses of single corner pairs."""

        def propose() -> None:
            corners = spread(lambda features: features.corners, (self._a, self._b))
            self.stats["num_corners_a"], self.stats["num_corners_b"] = (c.num_listed for c in corners)
            found = frame_poses(*corners)
            poses, is_observed = found.poses, found.is_observed
            is_allowed = self._allowed(poses)
            poses, is_observed = poses[is_allowed], is_observed[is_allowed]
            self.stats["num_hypotheses"] += len(poses)
            if len(poses) == 0:
                return
            a, b = self._a.prepared, self._b.prepared
            scores = rank_poses(a, b, poses, num_points=128)
            kept = np.argsort(-scores, kind="stable")[: 16 * MAX_FRAME_POSES]
            chosen = kept[
                distinct_poses(
                    poses[kept], scores[kept], np.asarray(b.centroid, np.float64),
                    metres=2.0 * a.grid.voxel_size, degrees=1.5, max_count=MAX_FRAME_POSES,
                )
            ]  # fmt: skip
            self._add(poses[chosen], ["corner" if is_observed[i] else "virtual corner" for i in chosen])

        self._timed("corner frames", propose)

    def add_subgraph(self, *, distance_tolerance: float, max_corners: int) -> None:
        """Add the poses of the maximum common subgraphs of the corners; tolerance in voxels."""

        def propose() -> None:
            found = subgraph_poses(
                self._a.corners, self._b.corners, max_corners=max_corners,
                distance_tolerance=distance_tolerance * self._a.prepared.grid.voxel_size,
            )  # fmt: skip
            self.stats["num_associations"] = found.num_associations
            self.stats["clique_size"] = found.clique_size
            self.stats["subgraph_completed"] = found.completed
            self.stats["num_hypotheses"] += len(found.poses)
            self._add(found.poses, ["subgraph"] * len(found.poses))

        self._timed("common subgraph", propose)

    def add_descriptors(self, *, max_poses: int) -> None:
        """Add the poses of the cliques of matched local descriptors."""

        def propose() -> None:
            use_free_space = self._a.prepared.has_free_space and self._b.prepared.has_free_space
            described = spread(
                lambda features: features.late.descriptors(use_free_space=use_free_space), (self._a, self._b)
            )
            poses, sizes = descriptor_hypotheses(described[0], described[1], max_hypotheses=max_poses)
            self.stats["descriptor_clique_size"] = int(sizes[0]) if len(sizes) else 0
            self.stats["num_hypotheses"] += len(poses)
            self._add(poses, ["descriptor"] * len(poses))

        self._timed("descriptors", propose)

    def add_exhaustive(self, *, max_rotations: int, num_peaks: int) -> None:
        """Add the best translations of all rotations that the normals allow."""

        def propose() -> None:
            a, b = self._a, self._b
            rotations, _ = rotation_hypotheses(
                a.normals, b.normals, a.directions, b.directions, max_rotations=max_rotations,
                is_signed=a.prepared.has_free_space and b.prepared.has_free_space,
                gravity_aligned=self._gravity_aligned,
            )  # fmt: skip
            self.stats["num_rotations"] = len(rotations)
            frame = upright_frame(a.directions, a.shares)
            poses, _ = exhaustive_hypotheses(a.prepared, b.prepared, rotations, frame, num_peaks=num_peaks)
            self.stats["num_hypotheses"] += len(poses)
            self._add(poses, ["exhaustive"] * len(poses))

        self._timed("exhaustive search", propose)

    def take(self) -> Proposals:
        """All poses added since the last call."""
        poses = np.concatenate(self._poses) if self._poses else np.zeros((0, 4, 4), np.float32)
        taken = Proposals(poses, tuple(self._sources))
        self._poses, self._sources = [], []
        return taken
