"""Leaders and verdicts written by hand."""

import numpy as np

from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.leaders import Leaders, Tried
from voxjax.registration.judging.verdict import Finding

ACCEPTED = Finding("accepted", 0.98, "One pose stands out.", 0.01)
NOTHING = Finding("no_overlap", 0.02, "No pose is supported.", 0.97)


def leaders(hits, conflicts):
    """One leader with these shares."""
    one = np.ones(1)
    nothing = np.zeros(1)
    judgement = Judgement(
        hits * one,
        conflicts * one,
        nothing,
        np.eye(3)[None],
        nothing,
        nothing,
        nothing,
        nothing,
        nothing,
        nothing,
    )
    poses = np.eye(4)[None]
    return Leaders(poses, judgement, ("exhaustive",), Tried(poses, judgement.strength()))
