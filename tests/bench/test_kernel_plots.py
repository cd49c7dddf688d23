"""Curves of the benchmark of kernels."""

from bench.kernel_plots import constant_surface
from kernel_rows_made_up import judged, made_row


def test_points_of_constant_surface_are_told_by_name_and_sorted():
    rows = [made_row(name=f"box_count 7 at constant surface, {s}") for s in ("512x512x256", "256x256x128")]
    curves = constant_surface([judged(row) for row in (*rows, made_row())])
    assert curves["ours"] == [(2.0**23, 1e-3), (2.0**26, 1e-3)]
