"""Candidate poses of map b in map a from four sources: corners, common subgraphs, descriptors, exhaustive search.

This package is for `pipeline.hypotheses`, which decides whom to ask. Start at `proposals`, where each source is a
function that gives `proposals.Proposals`, then at the source that you want to know.
"""
