"""Whether the mirror image of map b explains both maps better than map b does: a left-handed export, a flipped axis.

Conflicts alone do not tell: 4.5 to 8 % of what meets in mirrored buildings, and up to 7 % in sparse scans of a street.
The mirror image does: between places that are no mirror images of themselves it scores next to nothing.
"""

from ..judging.judgement import Judgement
from ..judging.leaders import Leaders
from ..judging.verdict import Finding
from .settings import CauseConfig


def conflict_share(judgement: Judgement) -> float:
    """Share of conflicts among the voxels that hit or conflict under the first pose; 0 where there is no pose."""
    if len(judgement.hits) == 0:
        return 0.0
    return float(judgement.conflicts[0] / max(judgement.hits[0] + judgement.conflicts[0], 1e-9))


def is_questionable(leaders: Leaders, finding: Finding, settings: CauseConfig) -> bool:
    """Whether something speaks against the first pose, so that causes are looked for.

    Where free space is not known nothing can speak against a pose, so that each is questioned.

    Args:
        leaders: Distinct poses, best first.
        finding: The verdict on the first.
        settings: How many conflicts are too many.
    """
    judgement = leaders.judgement
    if finding.verdict != "accepted" or not judgement.has_free_space:
        return True
    # Whole things in free space would be a narrower test, which a mirrored place seen by unlike sensors passed.
    return conflict_share(judgement) > settings.max_clean_conflict


def is_better(
    finding: Finding,
    given: Leaders,
    changed: Leaders,
    found: Finding,
    settings: CauseConfig,
    *,
    is_clear: bool,
) -> bool:
    """Whether a changed map b explains both maps clearly better than map b as it is.

    Args:
        finding: The verdict on the first of the leaders of the maps as they are.
        given: These leaders.
        changed: Leaders of map a and the changed map b.
        found: The verdict on the first of these.
        settings: How much better is clearly better.
        is_clear: Whether something else than the score tells the changed map from map b; a small gain is enough then.
    """
    # To take an acceptance back asks for another one; where there is none, a cause is named that is more probable than
    # not.
    if found.verdict != "accepted" and (finding.verdict == "accepted" or found.none >= 0.5):
        return False
    gain = settings.min_clear_gain if is_clear else settings.min_gain
    # Where it is open which pose of the changed map is right, those of the map as it is must be no rivals of them.
    if found.verdict != "accepted" and found.confidence <= 0.5:
        gain = max(gain, settings.min_open_gain)
    return best_strength(changed) > (1.0 + gain) * max(best_strength(given), 0.0)


def has_far_fewer_conflicts(given: Leaders, mirrored: Leaders) -> bool:
    """Whether less than half of what conflicts under the pose of map b as it is conflicts under that of its image.

    Args:
        given: Leaders of the maps as they are.
        mirrored: Leaders of map a and the mirror image of b.
    """
    return conflict_share(mirrored.judgement) < 0.5 * conflict_share(given.judgement)


def best_score(leaders: Leaders) -> float:
    """Score of the first pose; below everything where there is none."""
    return float(leaders.judgement.score()[0]) if len(leaders.poses) else -1.0


def best_strength(leaders: Leaders) -> float:
    """Strength of the first pose (`Judgement.strength`); below everything where there is none."""
    return float(leaders.judgement.strength()[0]) if len(leaders.poses) else -1.0


def mirrored_finding(finding: Finding, given: Leaders, mirrored: Leaders, found: Finding) -> Finding:
    """The verdict on a pose where the mirror image of map b explains the maps better.

    Args:
        finding: The verdict on the pose of map b as it is.
        given: Leaders of the maps as they are.
        mirrored: Leaders of map a and the mirror image of b.
        found: The verdict on the first of these.
    """
    reason = (
        "Map b seems to be mirrored: its mirror image lies in map a with a strength of "
        f"{best_strength(mirrored):.2f} and {100 * conflict_share(mirrored.judgement):.1f} % of what meets in "
        f"conflict, as it is with {best_strength(given):.2f} and {100 * conflict_share(given.judgement):.1f} %; flip "
        "one axis of one of the maps."
    )
    # At most one of both is right.
    confidence = min(finding.confidence, 1.0 - found.confidence)
    return finding._replace(verdict="ambiguous", confidence=confidence, reason=reason)
