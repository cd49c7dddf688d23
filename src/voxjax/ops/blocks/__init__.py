"""Sparse grids: blocks of 8 x 8 x 8 voxels with anything in them, and lists of occupied voxels.

Maps whose box is large are kept in blocks from the file to the fused map: start at `block_array.BlockArray`, of which
`windows` cuts parts and tiles; stores are read through `chunked_array.ChunkedArray`, and `kept` asks either the same
questions. Whoever counts at occupied voxels of large, mostly empty grids starts at
`choice.box_count_at`, which chooses between dense counts and counts in blocks.
"""
