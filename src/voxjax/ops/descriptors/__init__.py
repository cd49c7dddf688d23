"""Local descriptors of surface points (FPFH), their neighbours, and which descriptors match mutually.

This room is for `matching.descriptors`. Start at `fpfh.point_feature_histograms`, then `match.mutual_nearest`.
"""
