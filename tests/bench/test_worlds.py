"""Generated pairs of the benchmarks."""

from bench.cases import generated_cases
from bench.worlds import pair_case


def test_generated_pairs_have_all_kinds_and_depend_on_seed_and_number():
    cases = generated_cases(60, 7)
    assert {(c.kind, c.rotation) for c in cases} == {
        (kind, frame) for kind in ("pair", "none", "hotel") for frame in ("yaw", "tilt", "so3")
    }
    assert [c.kind for c in cases].count("pair") == 36
    assert pair_case(7, 3).options == pair_case(7, 3).options
    assert pair_case(7, 4).options != pair_case(8, 3).options
    for case in cases:
        assert 0.01 <= case.options["drift"] <= 0.06
        if case.kind == "hotel":
            assert 1 <= case.options["shared_columns"] <= case.options["rooms_per_side"]
