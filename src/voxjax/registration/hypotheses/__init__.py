"""Candidate poses of map b in map a from four sources: corners, common subgraphs, descriptors, exhaustive search.

This package is for `pipeline.pair`. Start at `proposals.ProposalCollector`, which asks the sources, then at the source
that you want to know.
"""
