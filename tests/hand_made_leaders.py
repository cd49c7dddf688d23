"""Leaders and verdicts written by hand."""

import numpy as np

from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.leaders import Leaders, Tried
from voxjax.registration.judging.verdict import Finding

ACCEPTED = Finding("accepted", 0.98, "One pose stands out.", 0.01)
NOTHING = Finding("no_overlap", 0.02, "No pose is supported.", 0.97)


def leaders(hits, conflicts, *, has_free_space=True):
    """One leader with these shares."""
    one = np.ones(1)
    nothing = np.zeros(1)
    judgement = Judgement(
        hits=hits * one,
        conflicts=conflicts * one,
        opposed=nothing,
        information=np.eye(3)[None],
        changed=nothing,
        moved=nothing,
        pieces=nothing,
        shared=nothing,
        exact=hits * one,
        exact_hits=hits * one,
        has_free_space=has_free_space,
    )
    poses = np.eye(4)[None]
    return Leaders(poses, judgement, ("exhaustive",), Tried(poses, judgement.strength()))
