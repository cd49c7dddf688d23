"""Corners and descriptors of two maps that belong together: consistency graphs and maximum common subgraphs.

This package is for `voxjax.consistency_graph` and `voxjax.maximum_common_subgraph`. Start at
`common_subgraph.maximum_common_subgraph`; `backtracking` is Algorithm 1 of the paper.
"""
