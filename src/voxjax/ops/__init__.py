"""Kernels on dense grids, on listed voxels, on blocks, tiles and device meshes; pure functions of arrays.

Most of them serve the stages of the pipeline. No stage uses `components` (`connected_components`, `label_voxels`,
`grow_regions`), `distance` (`distance_field`), `blocks` with `occupied_indices`, or `large` (tiles, device meshes):
they are doors of their own for whoever works on grids directly, kept by their tests and by `python -m bench kernels`.
"""

from .blocks.choice import box_count_at
from .blocks.compact import occupied_indices
from .blocks.counts import count_in_blocks, cut_blocks, dense_from_blocks, list_blocks, take_from_blocks
from .blocks.words import pack_words
from .components import connected_components, grow_regions, label_voxels
from .descriptors.fpfh import point_feature_histograms, surface_normals
from .descriptors.match import mutual_nearest
from .descriptors.tiles import near_tiles, point_tree
from .distance import distance_field
from .eigen import eigen_by_columns, symmetric_eigen
from .evidence.align import align_poses
from .evidence.lookup import Block
from .evidence.nearest import nearest_field, split_keys
from .evidence.scoring import evidence_codes, score_poses, surface_evidence
from .large.sharded import gather_shards, map_shards, shard_grid
from .large.sharded_blocks import gather_blocks, shard_blocks
from .large.sharded_scoring import score_in_shards, shard_codes
from .large.sharded_windows import classes_in_shards, count_in_shards
from .large.tiles import map_tiles
from .resampling.interpolate import backward_affine, resample_nearest, resample_trilinear
from .surface.moments import surface_moments
from .window.box import box_count
from .window.classes import count_change, count_steady_directions, window_classes

__all__ = [
    "Block",
    "align_poses",
    "backward_affine",
    "box_count",
    "box_count_at",
    "classes_in_shards",
    "connected_components",
    "count_change",
    "count_in_blocks",
    "count_in_shards",
    "count_steady_directions",
    "cut_blocks",
    "dense_from_blocks",
    "distance_field",
    "eigen_by_columns",
    "evidence_codes",
    "gather_blocks",
    "gather_shards",
    "grow_regions",
    "label_voxels",
    "list_blocks",
    "map_shards",
    "map_tiles",
    "mutual_nearest",
    "near_tiles",
    "nearest_field",
    "occupied_indices",
    "pack_words",
    "point_feature_histograms",
    "point_tree",
    "resample_nearest",
    "resample_trilinear",
    "score_in_shards",
    "score_poses",
    "shard_blocks",
    "shard_codes",
    "shard_grid",
    "split_keys",
    "surface_evidence",
    "surface_moments",
    "surface_normals",
    "symmetric_eigen",
    "take_from_blocks",
    "window_classes",
]
