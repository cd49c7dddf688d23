"""Leaders and verdicts written by hand."""

import numpy as np

from voxjax.registration.judging.judgement import Judgement
from voxjax.registration.judging.leaders import Leaders
from voxjax.registration.judging.verdict import Finding

ACCEPTED = Finding("accepted", 0.98, "One pose stands out.", 0.01)
NOTHING = Finding("no_overlap", 0.02, "No pose is supported.", 0.97)


def leaders(hits, conflicts):
    """One leader with these shares."""
    one = np.ones(1)
    judgement = Judgement(hits * one, conflicts * one, 0 * one, np.eye(3)[None], 0 * one, 0 * one)
    return Leaders(np.eye(4)[None], judgement, ("exhaustive",))
