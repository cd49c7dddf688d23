"""Why two maps contradict each other, or agree nowhere: one of them is mirrored, or has another unit of length.

No rigid pose is right then, and the best one may still look well: a mirrored building lies upside down in the other, a
map too large by 2 % fits in the middle. `handedness` holds the mirror image of map b against map b, `scale` aligns it
with its scale as one more parameter (`similarity`). This package is for `pipeline.causes`, which asks once the verdict
on the rigid pose is known; it may take an acceptance back, and never gives one.
"""
