"""Residuals of a pose: points on planes, distance fields, soft occupancies, matched corners, and terms of one's own.

This package is for whoever builds a problem by hand or writes a new residual. Start at `terms.Term`.
"""
