"""How map b lies in map a: hypotheses, their judging, the verdict, and the paper's own method.

This package is for `pipeline.pair`; users meet `types.Registration`, what `voxjax.register` returns. Start at
`hypotheses`, then `judging`.
"""
