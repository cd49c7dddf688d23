"""Reliability diagrams."""

from bench.plots import prepare_plots
from bench.reliability_plots import draw, draw_families
from family_rows_made_up import made_up
from matplotlib.image import imread


def test_each_family_has_a_panel(tmp_path):
    prepare_plots()
    few = [made_up("room_same_0"), made_up("room_same_1_cloud", confidence=0.2, right=False)]
    many = few + [
        made_up(f"{kind}_same_0", kind=kind) for kind in ("hall", "mine", "street", "tunnel", "forest")
    ]
    for name, rows in (("few", few), ("many", many)):
        draw_families(rows, tmp_path / "new" / f"{name}.png")
    small, large = (imread(tmp_path / "new" / f"{name}.png").shape for name in ("few", "many"))
    # Six panels in two rows of five.
    assert large[0] > 1.5 * small[0]
    assert large[1] > 3 * small[1]


def test_buildings_have_one_diagram(tmp_path):
    prepare_plots()
    rows = [
        {"kind": "pair", "confidence": 0.95, "right": True},
        {"kind": "cross", "confidence": 0.0, "right": False},
    ]
    draw(rows, tmp_path / "one.png")
    assert (tmp_path / "one.png").stat().st_size > 5_000
