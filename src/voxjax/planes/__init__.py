"""Planes of a map: surface elements, regions grown from the flattest, fits, and corners that the fits reject.

This package is for `features`. Start at `extract.extract_planes`.
"""
