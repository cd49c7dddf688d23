"""The verdict on judgements written by hand."""

import re

import numpy as np
import pytest

from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.settings import VerdictConfig
from voxjax.registration.judging.verdict import decide, probabilities, support

BOUNDS = VerdictConfig()


def judgement(*poses, has_free_space=True):
    """Each pose: hits, conflicts, least eigenvalue of the agreement, share of things that contradict.

    Agreement along the worst direction is exact.
    """
    hits, conflicts, weakest, changed = np.asarray(poses, np.float64).reshape(-1, 4).T
    information = (
        np.stack([np.diag([w, 0.3, 0.4]) / 3 for w in weakest]) if len(poses) else np.zeros((0, 3, 3))
    )
    nothing = np.zeros(len(hits))
    return Judgement(
        *(
            hits,
            conflicts,
            nothing,
            information,
            changed,
            100.0 * changed,
            changed,
            nothing + 1.0,
            weakest,
            hits,
        ),
        has_free_space=has_free_space,
    )


GOOD, WEAK = (0.6, 0.003, 0.2, 0.0), (0.04, 0.0, 0.001, 0.0)


@pytest.mark.parametrize(
    ("poses", "chance", "has_free_space", "expected"),
    [
        ([GOOD, WEAK], 0.04, True, "accepted"),
        ([GOOD], 0.02, True, "accepted"),
        ([WEAK, WEAK], 0.03, True, "no_overlap"),
        ([], 0.02, True, "no_overlap"),
        ([(0.2, 0.1, 0.2, 0.0)], 0.02, True, "no_overlap"),
        # A small share of agreement is enough where chance gives none, and not where many poses have it.
        ([(0.2, 0.002, 0.1, 0.0)], 0.02, True, "accepted"),
        ([(0.2, 0.002, 0.1, 0.0)] * 12, 0.09, True, "no_overlap"),
        ([GOOD, (0.59, 0.003, 0.2, 0.0)], 0.05, True, "ambiguous"),
        ([GOOD, (0.59, 0.003, 0.2, 0.1)], 0.05, True, "accepted"),
        ([(0.5, 0.003, 0.2, 0.0), (0.59, 0.003, 0.2, 0.15)], 0.05, True, "accepted"),
        ([(0.9, 0.003, 0.001, 0.0), WEAK], 0.04, True, "ambiguous"),
        # Without free space it decides how far a pose stands out, whatever share of the maps agrees.
        ([(0.95, 0.0, 0.7, 0.0), (0.4, 0.0, 0.1, 0.0)], 0.05, False, "accepted"),
        ([(0.4, 0.0, 0.1, 0.0), (0.38, 0.0, 0.01, 0.0)], 0.003, False, "accepted"),
        ([(0.5, 0.0, 0.17, 0.0), (0.45, 0.0, 0.18, 0.0)], 0.01, False, "ambiguous"),
        ([(0.5, 0.0, 0.17, 0.0), (0.45, 0.0, 0.18, 0.0)], 0.03, False, "no_overlap"),
    ],
)
def test_verdict_and_confidence_go_together(poses, chance, has_free_space, expected):
    finding = decide(judgement(*poses, has_free_space=has_free_space), chance, BOUNDS)
    assert finding.verdict == expected
    assert 0.0 <= finding.confidence <= 1.0
    assert (finding.confidence >= BOUNDS.min_confidence) == (expected == "accepted")
    assert finding.reason


@pytest.mark.parametrize("has_free_space", [True, False])
def test_probabilities_are_a_choice_among_the_leaders_and_none(has_free_space):
    three = judgement(GOOD, (0.5, 0.003, 0.2, 0.0), WEAK, has_free_space=has_free_space)
    shares = probabilities(three, 0.01)
    assert shares.shape == (4,)
    np.testing.assert_allclose(shares.sum(), 1.0)
    assert shares[1] > shares[2] > shares[3] == 0.0
    alone = probabilities(judgement(GOOD, has_free_space=has_free_space), 0.01)
    assert alone[1] > shares[1]
    assert alone[0] < shares[0]


def test_the_more_chance_reaches_the_less_a_pose_is_worth():
    shares = [probabilities(judgement(GOOD, WEAK), chance)[1] for chance in (0.02, 0.05, 0.1, 0.3, 0.6)]
    assert (np.diff(shares) < 0).all()


def test_beside_rivals_the_best_must_be_clean_itself():
    unclean = judgement((0.6, 0.003, 0.2, 0.03), (0.55, 0.003, 0.2, 0.3))
    finding = decide(unclean, 0.04, BOUNDS)
    assert finding.verdict == "ambiguous"
    assert "things of together" in finding.reason
    clean = judgement((0.6, 0.003, 0.2, 0.0), (0.55, 0.003, 0.2, 0.3))
    assert decide(clean, 0.04, BOUNDS).verdict == "accepted"
    # A little that contradicts is as good as none where hardly anything conflicts in pieces, and is not otherwise.
    little = judgement((0.6, 0.003, 0.2, 0.005), (0.55, 0.003, 0.2, 0.3))
    assert decide(little, 0.04, BOUNDS).verdict == "ambiguous"
    few_pieces = little._replace(pieces=np.asarray([0.002, 0.3]))
    assert decide(few_pieces, 0.04, BOUNDS).verdict == "accepted"


def test_what_contradicts_the_cleanest_rival_makes_all_of_them_less_probable():
    nones = [probabilities(judgement((0.6, 0.003, 0.2, share)), 0.04)[0] for share in (0.0, 0.01, 0.05, 0.2)]
    assert (np.diff(nones) > 0).all()


def test_the_more_poses_are_equally_strong_the_less_likely_one_of_them_is_right():
    nones = [probabilities(judgement(*[GOOD] * count), 0.04)[0] for count in (1, 2, 6, 12)]
    assert (np.diff(nones) > 0).all()
    shares = probabilities(judgement(*[GOOD] * 6), 0.04)[1:]
    np.testing.assert_allclose(shares, shares[0])


HELP = "what would help are maps that share more of the place."
HELP_CLOUDS = (
    "what would help are sensor origins, which tell free space, or maps that share more of the place."
)
MOVED = (
    "Walls agree, but things of together 10.0 m2 stand in free space of the other map, 10.0 % of what is no wall, "
    "floor or ceiling, as in another storey of one plan, in a place that repeats, or where things were moved, which "
    "allow_changes (--allow-changes) "
)
REASONS = {
    "no pose": ([], 0.02, f"No source proposed a pose: the maps have too little structure; {HELP}"),
    "no strength": (
        [(0.2, 0.1, 0.2, 0.0)],
        0.02,
        "No pose stands out: conflicts outweigh what agrees under each of them (20 % of the surfaces agree, 33.3 % of "
        f"what meets conflicts under the best); {HELP}",
    ),
    "chance": (
        [WEAK],
        0.03,
        "No pose stands out: the strongest is 1.3 times as strong as what chance gives in these maps, where more than "
        "2.3 times would be needed (the best: 4 % of the surfaces agree, 0.0 % of what meets conflicts); "
        + HELP,
    ),
    "many alike": (
        [WEAK, WEAK],
        0.03,
        "No pose stands out: the strongest is 1.3 times as strong as what chance gives in these maps, where more than "
        "2.9 times would be needed beside 1 alike (the best: 4 % of the surfaces agree, 0.0 % of what meets "
        f"conflicts); {HELP}",
    ),
    "conflicts": (
        [(0.9, 0.1, 0.5, 0.0)],
        0.02,
        "Occupied and free space contradict each other too often, in more than 8 % of what meets, as where maps drift "
        "or most things were moved; what would help are maps that drift less, or of one day: 90 % of the surfaces "
        "agree, 10.0 % of what meets conflicts.",
    ),
    "sliding": (
        [(0.9, 0.0, 0.001, 0.0)],
        0.04,
        "The best pose can slide along a direction that no surface fixes; what would help are maps that show something "
        "across it, as the end of a corridor: 90 % of the surfaces agree, 0.0 % of what meets conflicts.",
    ),
    "moved things": (
        [(0.6, 0.0, 0.2, 0.1)],
        0.04,
        MOVED + "accepts: 60 % of the surfaces agree, 0.0 % of what meets conflicts.",
    ),
    "moved things of a weak pose": (
        [(0.1, 0.0, 0.2, 0.1)],
        0.04,
        MOVED + "alone would not accept: 10 % of the surfaces agree, 0.0 % of what meets conflicts.",
    ),
    "few moved things": (
        [(0.4, 0.0, 0.2, 0.03)],
        0.1,
        "The best pose stands out of chance, but things of together 3.0 m2 stand in free space of the other map "
        "(probability 0.74, of 0.85 needed): 40 % of the surfaces agree, 0.0 % of what meets conflicts; if they were "
        "moved, allow_changes (--allow-changes) accepts it.",
    ),
    "a rival": (
        [GOOD, (0.59, 0.003, 0.2, 0.0)],
        0.05,
        "Another pose explains the maps almost as well (probability 0.49, against 0.51 of the best, which would need "
        f"0.90): 60 % of the surfaces agree, 0.5 % of what meets conflicts; {HELP}",
    ),
    "not enough": (
        [(0.1, 0.0, 0.1, 0.0)],
        0.03,
        "The best pose stands out of chance, but not by enough (probability 0.81, of 0.85 needed): 10 % of the "
        f"surfaces agree, 0.0 % of what meets conflicts; {HELP}",
    ),
    "accepted": (
        [GOOD, WEAK],
        0.04,
        "One pose stands out, 14.5 times as strong as chance: 60 % of the surfaces agree, 0.5 % of what meets "
        "conflicts; probability 0.999.",
    ),
}


@pytest.mark.parametrize("case", REASONS)
def test_reasons_say_what_decided_and_what_would_help(case):
    poses, chance, reason = REASONS[case]
    assert decide(judgement(*poses), chance, BOUNDS).reason == reason


@pytest.mark.parametrize("has_free_space", [True, False])
@pytest.mark.parametrize("count", [1, 3])
def test_a_pose_of_so_many_times_chance_as_a_reason_asks_for_stands_out(count, has_free_space):
    chance = 0.02

    def found(times):
        # Without free space the strength is the square of such a share.
        share = times * chance if has_free_space else (times * chance) ** 0.5
        poses = [(share, 0.0, share, 0.0)] * count
        return decide(judgement(*poses, has_free_space=has_free_space), chance, BOUNDS)

    said, needed = re.findall(r"([\d.]+) times (?:as strong|would be)", found(1.5).reason)
    assert said == "1.5"
    # The figure is rounded to a decimal.
    assert found(float(needed) - 0.06).verdict == "no_overlap"
    assert found(float(needed) + 0.06).verdict != "no_overlap"


def test_reasons_of_clouds_ask_for_sensor_origins_and_say_that_free_space_is_unknown():
    lost = decide(judgement(*[(0.3, 0.0, 0.1, 0.0)] * 2, has_free_space=False), 0.03, BOUNDS).reason
    assert lost.endswith(f"free space unknown); {HELP_CLOUDS}")
    assert decide(judgement(has_free_space=False), 0.03, BOUNDS).reason.endswith(HELP_CLOUDS)
    sure = judgement((0.95, 0.0, 0.7, 0.0), has_free_space=False)
    assert "conflicts, free space unknown;" in decide(sure, 0.05, BOUNDS).reason


def test_a_reason_says_that_free_space_was_inferred():
    finding = decide(judgement(GOOD, WEAK), 0.04, BOUNDS, is_inferred=True)
    assert "conflicts, free space inferred from what encloses it;" in finding.reason


def test_things_that_contradict_make_a_pose_ambiguous_unless_changes_are_allowed():
    changed = judgement((0.6, 0.003, 0.2, 0.1), WEAK)
    doubted = decide(changed, 0.04, BOUNDS)
    assert doubted.verdict == "ambiguous"
    assert doubted.confidence <= 0.5
    assert "10.0 % of what is no wall, floor or ceiling" in doubted.reason
    assert "--allow-changes" in doubted.reason
    allowed = decide(changed, 0.04, BOUNDS, allow_changes=True)
    assert allowed.verdict == "accepted"
    np.testing.assert_allclose(allowed.confidence, decide(judgement(GOOD, WEAK), 0.04, BOUNDS).confidence)
    # What does not stand out of chance does not for being allowed to contradict.
    assert decide(judgement(*[WEAK] * 3), 0.02, BOUNDS, allow_changes=True).verdict == "no_overlap"


def test_support_is_the_agreement_along_the_worst_direction():
    information = np.stack(
        [np.eye(3) / 3, np.diag([0.4, 0.3, 0.4]) / 3 * [1, 1 / 3, 1], np.diag([1.0, 1.0, 0.0])]
    )
    one, nothing = np.ones(3), np.zeros(3)
    full = Judgement(one, one, one, information, nothing, nothing, nothing, nothing, nothing, nothing)
    np.testing.assert_allclose(support(full), [1.0, 0.1, 0.0], atol=1e-12)
