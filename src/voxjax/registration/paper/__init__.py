"""The published registration on its own: matched corners, tie-break and transform of section IV of the paper.

This package is for the preset "paper". Start at `register.register_paper`, which reads as the paper's steps.
"""
