"""Planes of a map: growing, consolidating, fitting."""
