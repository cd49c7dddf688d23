"""The verdict: which pose is right, how probable is that, or does nothing stand out of chance?

Each pose has a strength (`Judgement.strength`). The poses that are about as strong as the best are its rivals, and
chance is what the strongest of all other poses of the pair reaches. First: is one of the rivals right? The logarithm of
the odds is

    none + strength * log(s) + contrast * log(s / chance) - changed * log(1 + c / usual) - crowd * log(n),

with s the strength of the best of n rivals, and c what contradicts the cleanest of them (`contradictions`). The
contrast is what holds everywhere. Where many poses are equally strong, chance or repetition makes them, and the right
one need not be among the leaders. Second: which of the rivals? The strongest, net of what contradicts it (`rivals`).
Third: things that stand in free space of the other map, beyond what drift explains, make a pose ambiguous.

The coefficients lie near those of greatest likelihood on families of generated places, each of them left out once to
see that they hold where they were not fitted (`python -m bench verdict_fit`), rounded to the side of fewer accepts.
"""

from typing import NamedTuple

import numpy as np

from ..types import Verdict
from .judgement import Judgement, along_worst_direction
from .rivals import net_strengths, rivals
from .settings import VerdictConfig


class Coefficients(NamedTuple):
    """Coefficients of the model.

    Attributes:
        none: Logarithm of the odds of a single, clean pose of strength 1 that chance reaches, too.
        strength: Coefficient of the logarithm of the strength.
        contrast: Coefficient of the logarithm of the strength over chance.
        changed: Coefficient of the logarithm of how much more contradicts than in any pose.
        crowd: Coefficient of the logarithm of the number of rivals.
    """

    none: float
    strength: float
    contrast: float
    changed: float
    crowd: float


WITH_FREE_SPACE = Coefficients(none=4.0, strength=2.0, contrast=1.7, changed=2.5, crowd=1.4)
WITHOUT_FREE_SPACE = Coefficients(none=-3.2, strength=0.0, contrast=2.6, changed=0.0, crowd=1.0)
"""Without free space nothing can speak against a pose, and how large a share of a map agrees says little."""


class Standing(NamedTuple):
    """How the rivals for the first place stand against chance.

    Attributes:
        strength: Strength of the best of them, above 0.
        chance: Strength that poses reach by chance in this pair (`chance_level`).
        changed: What contradicts the cleanest of them, as a share (`contradictions`).
        num_rivals: How many of them are as good, net of what conflicts (`net_strengths`).
    """

    strength: float
    chance: float
    changed: float
    num_rivals: int

    def terms(self, settings: VerdictConfig) -> np.ndarray:
        """What the coefficients weigh, in their order (5,).

        Args:
            settings: How much contradicts any pose.
        """
        against = -np.log1p(self.changed / settings.usual_changes), -np.log(self.num_rivals)
        return np.asarray([1.0, np.log(self.strength), np.log(self.strength / self.chance), *against])


class Finding(NamedTuple):
    """The verdict with what it rests on.

    Attributes:
        verdict: "accepted", "ambiguous" or "no_overlap".
        confidence: Probability that the first pose is right.
        reason: One sentence for a person.
        none: Probability that no leader is right.
        standing: How the best poses stand against chance; None where none has any strength.
    """

    verdict: Verdict
    confidence: float
    reason: str
    none: float
    standing: Standing | None = None


def support(judgement: Judgement) -> np.ndarray:
    """Agreement along the worst direction (k,): 1 when all surfaces of both maps agree."""
    return along_worst_direction(judgement.information)


def standing_of(judgement: Judgement, chance: float, settings: VerdictConfig) -> Standing | None:
    """How the rivals stand against chance; None where no pose has any strength.

    Args:
        judgement: Evidence of the leaders.
        chance: Strength that poses reach by chance (`chance_level`).
        settings: Which poses are rivals.
    """
    is_rival = rivals(judgement, settings.min_rival_share)
    if not is_rival.any():
        return None
    net = np.where(is_rival, net_strengths(judgement, settings), 0.0)
    count = int(np.count_nonzero(net >= settings.min_rival_share * net.max()))
    return Standing(
        float(judgement.strength().max()), chance, float(judgement.changed[np.argmax(net)]), count
    )


def probabilities(
    judgement: Judgement,
    chance: float,
    settings: VerdictConfig | None = None,
    *,
    allow_changes: bool = False,
) -> np.ndarray:
    """Probability (k + 1,) that no leader is right, and that each of them is.

    Args:
        judgement: Evidence of the leaders.
        chance: Strength that poses reach by chance (`chance_level`).
        settings: Which poses are rivals, and how much their strengths weigh; None for the defaults.
        allow_changes: Whether contradictions tell rivals apart alone, and speak against none of them.
    """
    settings = VerdictConfig() if settings is None else settings
    standing = standing_of(judgement, chance, settings)
    if standing is None:
        return np.concatenate([[1.0], np.zeros(len(judgement.hits))])
    one_of_them = 1.0 / (1.0 + np.exp(-_odds(judgement, standing, settings, allow_changes=allow_changes)))
    is_rival = rivals(judgement, settings.min_rival_share)
    within = np.where(is_rival, net_strengths(judgement, settings), 0.0) ** settings.rival_weight
    return np.concatenate([[1.0 - one_of_them], one_of_them * within / within.sum()])


def _odds(judgement: Judgement, standing: Standing, settings: VerdictConfig, *, allow_changes: bool) -> float:
    """Logarithm of the odds that one of the rivals is right."""
    weight = WITH_FREE_SPACE if judgement.has_free_space else WITHOUT_FREE_SPACE
    if allow_changes:
        weight = weight._replace(changed=0.0)
    return float(np.dot(weight, standing.terms(settings)))


def decide(
    judgement: Judgement,
    chance: float,
    settings: VerdictConfig,
    *,
    is_inferred: bool = False,
    allow_changes: bool = False,
) -> Finding:
    """Decide about the first pose of a judgement whose poses are distinct and best first.

    Args:
        judgement: Evidence of the leaders.
        chance: Strength that poses reach by chance (`chance_level`).
        settings: What an accepted pose must reach.
        is_inferred: Whether free space of a map was inferred (`inferred_space`), which the reason mentions.
        allow_changes: Whether a pose is accepted although things were moved between the maps.
    """
    if len(judgement.hits) == 0:
        help_ = _help(judgement)
        reason = (
            f"No source proposed a pose: the maps have too little structure; what would help are {help_}."
        )
        return Finding("no_overlap", 0.0, reason, 1.0)
    standing = standing_of(judgement, chance, settings)
    shares = probabilities(judgement, chance, settings, allow_changes=allow_changes)
    none, confidence = float(shares[0]), float(shares[1])
    shown = _shown(judgement, is_inferred=is_inferred)
    # No overlap is the answer where nothing stands out of chance, whatever contradicts it.
    if standing is None or _odds(judgement, standing, settings, allow_changes=True) < 0.0:
        reason = _why_nothing(judgement, standing, settings, shown)
        return Finding("no_overlap", confidence, reason, none, standing)
    needed = settings.min_confidence
    if rivals(judgement, settings.min_rival_share)[1:].any() and judgement.has_free_space:
        needed = settings.min_confidence_beside_rivals
    # What would be found if things may have been moved, which reasons promise only where it holds.
    is_allowed_enough = bool(probabilities(judgement, chance, settings, allow_changes=True)[1] >= needed)
    doubt = _doubt(judgement, settings, allow_changes=allow_changes, is_allowed_enough=is_allowed_enough)
    if doubt is not None:
        return Finding("ambiguous", min(confidence, 0.5), f"{doubt}: {shown}.", none, standing)
    if confidence < needed:
        reason = _why_unsure(judgement, shares, needed, shown, is_allowed_enough=is_allowed_enough)
        return Finding("ambiguous", confidence, reason, none, standing)
    times = float(judgement.strength()[0]) / chance
    reason = (
        f"One pose stands out, {times:.1f} times as strong as chance: {shown}; probability {confidence:.3f}."
    )
    return Finding("accepted", confidence, reason, none, standing)


def _conflict(judgement: Judgement) -> float:
    """Share of what meets that conflicts under the first pose."""
    return float(judgement.conflicts[0] / max(judgement.hits[0] + judgement.conflicts[0], 1e-9))


def _doubt(
    judgement: Judgement, settings: VerdictConfig, *, allow_changes: bool, is_allowed_enough: bool
) -> str | None:
    """What no probability makes up for, if the first pose has that.

    Args:
        judgement: Evidence of the leaders.
        settings: How much of each is too much.
        allow_changes: Whether things may have been moved between the maps.
        is_allowed_enough: Whether the pose would be probable enough if they may.
    """
    if _conflict(judgement) > settings.max_conflict:
        return (
            "Occupied and free space contradict each other too often, in more than "
            f"{100 * settings.max_conflict:g} % of what meets, as where maps drift or most things were moved; what "
            "would help are maps that drift less, or of one day"
        )
    if support(judgement)[0] < settings.min_support:
        return (
            "The best pose can slide along a direction that no surface fixes; what would help are maps that show "
            "something across it, as the end of a corridor"
        )
    # Among equal rooms the cleanest pose may still be a false one, where the true one is not among the leaders.
    is_contested = bool(rivals(judgement, settings.min_rival_share)[1:].any())
    changed, area = float(judgement.changed[0]), float(judgement.moved[0])
    most = settings.max_changes_beside_rivals if is_contested else settings.max_changes
    is_clean = is_contested and judgement.pieces[0] <= settings.max_pieces * judgement.shared[0]
    if allow_changes or changed <= most or is_clean:
        return None
    accepts = "accepts" if is_allowed_enough else "alone would not accept"
    return (
        f"Walls agree, but things of together {area:.1f} m2 stand in free space of the other map, "
        f"{100 * changed:.1f} % of what is no wall, floor or ceiling, as in another storey of one plan, in a place "
        f"that repeats, or where things were moved, which allow_changes (--allow-changes) {accepts}"
    )


def _shown(judgement: Judgement, *, is_inferred: bool) -> str:
    """What speaks for the first pose and against it, and where the free space is from."""
    agree, conflict = 100 * judgement.hits[0], 100 * _conflict(judgement)
    shown = f"{agree:.0f} % of the surfaces agree, {conflict:.1f} % of what meets conflicts"
    if not judgement.has_free_space:
        return f"{shown}, free space unknown"
    return f"{shown}, free space inferred from what encloses it" if is_inferred else shown


def _help(judgement: Judgement) -> str:
    """What would make another verdict possible."""
    more = "maps that share more of the place"
    return more if judgement.has_free_space else f"sensor origins, which tell free space, or {more}"


def _why_nothing(judgement: Judgement, standing: Standing | None, settings: VerdictConfig, shown: str) -> str:
    """Why no pose is believed."""
    # Where conflicts outweigh what agrees, a pose has no strength, and is no multiple of chance.
    if standing is None:
        return (
            f"No pose stands out: conflicts outweigh what agrees under each of them ({shown} under the best); "
            f"what would help are {_help(judgement)}."
        )
    # The first pose is the cleanest of the strong ones, not always the strongest, by which all of them are judged.
    times = standing.strength / standing.chance
    weight = WITH_FREE_SPACE if judgement.has_free_space else WITHOUT_FREE_SPACE
    odds = _odds(judgement, standing, settings, allow_changes=True)
    needed = times * np.exp(-odds / (weight.strength + weight.contrast))
    alike = "" if standing.num_rivals == 1 else f" beside {standing.num_rivals - 1} alike"
    return (
        f"No pose stands out: the strongest is {times:.1f} times as strong as what chance gives in these maps, where "
        f"more than {needed:.1f} times would be needed{alike} (the best: {shown}); "
        f"what would help are {_help(judgement)}."
    )


def _why_unsure(
    judgement: Judgement, shares: np.ndarray, needed: float, shown: str, *, is_allowed_enough: bool
) -> str:
    """Whether another pose, what contradicts, or chance is the likeliest way in which the first pose could be wrong."""
    none, confidence = shares[0], shares[1]
    rival = shares[2:].max(initial=0.0)
    more = f"{shown}; what would help are {_help(judgement)}"
    if rival > none:
        return (
            f"Another pose explains the maps almost as well (probability {rival:.2f}, against {confidence:.2f} of the "
            f"best, which would need {needed:.2f}): {more}."
        )
    if is_allowed_enough:
        return (
            f"The best pose stands out of chance, but things of together {judgement.moved[0]:.1f} m2 stand in free "
            f"space of the other map (probability {confidence:.2f}, of {needed:.2f} needed): {shown}; if they were "
            "moved, allow_changes (--allow-changes) accepts it."
        )
    return (
        f"The best pose stands out of chance, but not by enough (probability {confidence:.2f}, of {needed:.2f} "
        f"needed): {more}."
    )
