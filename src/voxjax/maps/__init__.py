"""One map made ready for all its pairs: fields of the nearest surface, evidence codes, normals and inferred free space.

This package is for the stages that compare two maps, refinement and registration. Start at `prepared.prepare_map`.
`isolated` tells strays far away from the map proper, for readers of files too, and `findings` puts what is odd about a
map into remarks.
"""
