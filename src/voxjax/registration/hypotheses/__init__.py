"""Candidate poses of map b in map a from four sources: corners, common subgraphs, descriptors, exhaustive search.

This package is for `pipeline.hypotheses`, which asks the sources. Start at `proposals.admit` and the functions
beside it, one for each source, then at the source that you want to know.
"""
