"""Counts of the 7 x 7 x 7 sliding window and the classes flat, edge and corner that follow from them.

This room is for corner detection after section III of the paper, and for whoever needs box counts of a dense grid.
Start at `box.box_count` (how many) and `classes.window_classes` (what the counts mean).
"""
