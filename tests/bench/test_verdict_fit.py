"""The fit of the verdict's model."""

import json

import numpy as np
from bench.verdict_fit import design, fit, left_out, main, usable

from voxjax.registration.judging.settings import VerdictConfig
from voxjax.registration.judging.verdict import Standing


def row(strength, *, chance=0.02, changed=0.0, num_rivals=1, right=True, **other):
    return {
        "evidence": Standing(strength, chance, changed, num_rivals)._asdict(),
        "is_group_right": right,
        "free_space": "observed",
        "role": "same" if right else "elsewhere",
        "kind": "garage",
    } | other


def made_up(rng, kind):
    """Right poses stand out and are clean; wrong ones are weak, one of a crowd, or contradicted."""
    rows = []
    for _ in range(25):
        rows.append(row(rng.uniform(0.2, 0.9), chance=0.03, kind=kind))
        rows.append(row(rng.uniform(0.01, 0.05), right=False, kind=kind))
        rows.append(row(rng.uniform(0.2, 0.9), num_rivals=12, chance=0.1, right=False, kind=kind))
        rows.append(row(rng.uniform(0.2, 0.9), changed=rng.uniform(0.05, 0.2), right=False, kind=kind))
    return rows


def test_the_fit_finds_what_tells_right_poses_and_holds_for_the_family_left_out():
    rng = np.random.default_rng(0)
    rows = [each for kind in ("garage", "mine", "street") for each in made_up(rng, kind)]
    weights = fit(*design(rows))
    assert weights.strength > 0.5
    assert weights.changed > 0.5
    assert weights.crowd > 0.5
    for family, count, right, accepted, wrong, error in left_out(rows):
        assert family in ("garage", "mine", "street")
        assert (count, right) == ("100", "25")
        assert int(accepted) >= 20
        assert int(wrong) <= 1
        assert float(error) < 0.1


def test_terms_are_those_of_the_verdict_in_the_order_of_its_coefficients():
    terms, is_right = design([row(0.5, chance=0.1, changed=0.02, num_rivals=3)])
    usual = VerdictConfig.usual_changes
    expected = [1.0, np.log(0.5), np.log(5.0), -np.log1p(0.02 / usual), -np.log(3)]
    np.testing.assert_allclose(terms, [expected])
    np.testing.assert_array_equal(is_right, [1.0])


def test_rows_with_a_cause_of_their_own_or_without_a_pose_are_left_out():
    rows = [
        row(0.5),
        row(0.5, role="mirrored"),
        row(0.5, role="scaled"),
        row(0.5, free_space="unknown"),
        row(0.5, evidence=None),
        row(0.5, free_space="inferred"),
    ]
    assert usable(rows, has_free_space=True) == [rows[0], rows[5]]
    assert usable(rows, has_free_space=False) == [rows[3]]


def test_the_command_prints_both_fits(tmp_path, capsys):
    rng = np.random.default_rng(1)
    rows = made_up(rng, "garage") + made_up(rng, "mine")
    path = tmp_path / "rows.json"
    path.write_text(json.dumps({"rows": rows + [each | {"free_space": "unknown"} for each in rows]}))
    assert main([str(path)]) == 0
    said = capsys.readouterr().out
    assert "with free space: 200 pairs" in said
    assert "without free space: 200 pairs" in said
    assert said.count("| mine |") == 2
