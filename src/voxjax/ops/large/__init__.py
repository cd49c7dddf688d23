"""Kernels on grids that fit neither one device nor memory: tile by tile, or in parts on several devices.

No stage of the pipeline uses this room; it is a door of its own for whoever has one huge grid. Start at
`tiles.map_tiles` (NumPy and Zarr), at `sharded_blocks.shard_blocks` (a map in blocks over a device mesh, in parts that
hold equally many blocks), or at `sharded.map_shards` (a dense array over a mesh, cut into equal boxes).
"""
