"""Kernels on grids that fit neither one device nor memory: tile by tile, or as shards of several devices.

No stage of the pipeline uses this room; it is a door of its own for whoever has one huge grid. Start at
`tiles.map_tiles` (NumPy and Zarr) or `sharded.map_shards` (a device mesh).
"""
