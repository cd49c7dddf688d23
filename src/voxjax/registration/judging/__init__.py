"""From many hypotheses to one verdict: leaders are refined and judged by all voxels, then weighed against chance.

This package is for `pipeline.pair`. Start at `leaders.find_leaders`, then `rivals.weigh_rivals`
and `verdict.decide`.
"""
