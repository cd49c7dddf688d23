"""Rows of the calibration of families that no registration gave."""


def made_up(name, **other):
    return {
        "name": name,
        "kind": "room",
        "role": "same",
        "overlap": 0.5,
        "factor": 1.0,
        "verdict": "accepted",
        "confidence": 0.9,
        "right": True,
        "reason": "One pose stands out.",
    } | other
