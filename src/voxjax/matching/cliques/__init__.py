"""Exact maximum cliques of a consistency graph, on the host: bounds, branching, budget and packed rows.

This package is for `matching.common_subgraph` and for whoever has a graph of their own. Start at
`maximum.maximum_clique`.
"""
