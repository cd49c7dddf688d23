"""Settings of the judging: how many poses survive each stage, and when one is accepted."""

import dataclasses


@dataclasses.dataclass(frozen=True)
class LeaderConfig:
    """How many hypotheses survive each stage.

    Attributes:
        num_ranked: Distinct poses judged at the coarse tolerance.
        num_refined: Distinct poses refined.
        num_leaders: Distinct refined poses judged by all voxels.
    """

    num_ranked: int = 512
    num_refined: int = 64
    num_leaders: int = 12


@dataclasses.dataclass(frozen=True)
class VerdictConfig:
    """When a pose is accepted; the model is in `registration/judging/verdict.py`.

    Attributes:
        min_confidence: Least probability of an accepted pose.
        min_confidence_beside_rivals: The same where free space must decide between poses that score alike.
        max_conflict: Largest share of conflicts among the voxels that hit or conflict.
        min_support: Least agreement along the worst direction, as a share of all that both maps could show.
        max_pieces: Largest area of conflicts that hang together, as a share of the surface that agrees, where other
            poses score almost as well.
    """

    min_confidence: float = 0.85
    min_confidence_beside_rivals: float = 0.9
    max_conflict: float = 0.08
    min_support: float = 0.005
    max_pieces: float = 0.003
