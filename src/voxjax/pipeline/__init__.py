"""The verbs of voxjax: `register`, `register_batch` and `merge`, with their settings and the report.

This package is the only one that sees all stages and the only place where settings meet them. `register` is in
`pair`, `merge` in `many`, `register_batch` in `batch`. Start at `pair.register_features`, which reads as the algorithm,
and at `config.Config`.
"""
