"""Candidate poses of map b in map a from four sources: corners, common subgraphs, descriptors, exhaustive search.

Corners propose under two names, "corner" and "virtual corner", and a pose that the caller brings is a "guess": these
are the six names of a source in `registration.types.Hypothesis`. This package is for `pipeline.hypotheses`,
which asks the sources. Start at `proposals.propose_exhaustively`, which decides most pairs alone, then at the functions
of the other sources beside it; `proposals.admit` joins what they found.
"""
