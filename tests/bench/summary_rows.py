"""Rows of the registration benchmark, made up."""


def row(method="ours", **changes):
    base = {
        "case": "sim/x",
        "source": "sim",
        "kind": "pair",
        "rotation": "yaw",
        "overlap": 0.5,
        "method": method,
        "right": True,
        "rank": 0,
        "degrees": 0.5,
        "metres": 0.1,
        "accepted": True,
        "seconds": 2.0,
    }
    return base | changes
