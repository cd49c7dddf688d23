"""Every public kernel is lowered for CUDA on a host without a GPU: what no compiler could take is found here."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from device_path import lowered_for_cuda, rounded_products
from small_codes import mesh_of
from voxjax import ops
from voxjax.ops.descriptors.tiles import NearTiles
from voxjax.ops.evidence.correlate import coarse_spectra, correlation_peaks
from voxjax.ops.large.sharded_blocks import ShardedBlocks
from voxjax.ops.large.sharded_scoring import ShardedCodes
from voxjax.ops.surface.faces import corner_faces
from voxjax.ops.surface.neighbourhood import ball_sums, neighbourhood
from voxjax.ops.surface.soft_planes import soft_planes


def _of(dtype: Any, *shape: int) -> Any:
    return jax.ShapeDtypeStruct(shape, dtype)


GRID, FLAT, ROWS = _of(jnp.bool_, 16, 16, 32), _of(jnp.uint8, 8192), _of(jnp.int32, 64, 3)
STATES, KEYS, MASK, DIMS = (
    _of(jnp.uint8, 16, 16, 32),
    _of(jnp.uint32, 8192),
    _of(jnp.bool_, 64),
    _of(jnp.int32, 3),
)
VECTOR, POINTS, WEIGHTS, POSES = (
    _of(jnp.float32, 3),
    _of(jnp.float32, 64, 3),
    _of(jnp.float32, 64),
    _of(jnp.float32, 5, 4, 4),
)
AFFINE, NUMBER, FLAG = _of(jnp.float32, 3, 4), _of(jnp.float32), _of(jnp.bool_)
NEAR = NearTiles(_of(jnp.int32, 10, 8), _of(jnp.int32, 6), _of(jnp.int32, 6, 16))
WORDS, FLAGS = _of(jnp.uint32, 32, 32, 3), _of(jnp.bool_, 2, 2, 4)
BLOCK = ops.Block(DIMS, VECTOR, NUMBER)
SPECTRA = (_of(jnp.complex64, 16, 16, 9),) * 4
CELLS = (16, 16, 16)


def _blocks(words: Any, flags: Any) -> Any:
    return ops.count_in_blocks(ops.cut_blocks(words, flags, halo=3, capacity=16), size=7)


KERNELS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    "align_poses": (ops.align_poses, (KEYS, BLOCK, POINTS, POINTS, POINTS, WEIGHTS, POSES)),
    "box_count": (ops.box_count, (GRID,)),
    "box_count packed": (lambda g: ops.box_count(g, implementation="packed"), (GRID,)),
    "box_count summed_area": (lambda g: ops.box_count(g, implementation="summed_area"), (GRID,)),
    "box_count pallas": (lambda g: ops.box_count(g, implementation="pallas"), (GRID,)),
    "box_count_at": (ops.box_count_at, (GRID, ROWS)),
    "count_change": (ops.count_change, (GRID,)),
    "count_in_blocks": (_blocks, (WORDS, FLAGS)),
    "distance_field": (lambda g: ops.distance_field(g, radius=5, voxel_size=0.1), (GRID,)),
    "eigen_by_columns": (ops.eigen_by_columns, (_of(jnp.float32, 6, 64),)),
    "evidence_codes": (lambda s, k: ops.evidence_codes(s, k, 2, 4), (FLAT, KEYS)),
    "grow_regions": (
        lambda i, m, n, d, c: ops.grow_regions(i, m, n, d, c, flat_size=1 << 15),
        (ROWS, MASK, POINTS, DIMS, NUMBER),
    ),
    "label_voxels": (lambda i, m, d: ops.label_voxels(i, m, d, flat_size=1 << 15), (ROWS, MASK, DIMS)),
    "mutual_nearest": (ops.mutual_nearest, (_of(jnp.float32, 64, 33), _of(jnp.float32, 64, 33), MASK, MASK)),
    "nearest_field": (
        lambda i, m, d: ops.split_keys(ops.nearest_field(i, m, d, flat_size=8192, radius=5)),
        (ROWS, MASK, DIMS),
    ),
    "occupied_indices": (lambda g: ops.occupied_indices(g, size=64), (GRID,)),
    "pack_words": (ops.pack_words, (GRID,)),
    "point_feature_histograms": (
        lambda p, n, near, r, s: ops.point_feature_histograms(p, n, near, radius=r, spacing=s),
        (POINTS, POINTS, NEAR, NUMBER, NUMBER),
    ),
    "surface_normals": (lambda p, near, r: ops.surface_normals(p, near, radius=r), (POINTS, NEAR, NUMBER)),
    "score_poses": (ops.score_poses, (FLAT, BLOCK, POINTS, WEIGHTS, POSES)),
    "surface_evidence": (
        ops.surface_evidence,
        (FLAT, KEYS, BLOCK, POINTS, POINTS, POINTS, WEIGHTS, POSES, FLAG),
    ),
    "surface_moments": (ops.surface_moments, (STATES, ROWS)),
    "symmetric_eigen": (ops.symmetric_eigen, (_of(jnp.float32, 9, 3, 3),)),
    "window_classes": (ops.window_classes, (GRID, _of(jnp.int32))),
    "window_classes pallas": (
        lambda g, c: ops.window_classes(g, c, implementation="pallas"),
        (GRID, _of(jnp.int32)),
    ),
    "coarse_spectra": (
        lambda *given: coarse_spectra(*given, cells=CELLS),
        (FLAT, BLOCK, POINTS, WEIGHTS, _of(jnp.float32, 3, 3), VECTOR, NUMBER, NUMBER),
    ),
    "correlation_peaks": (lambda *s: correlation_peaks(*s, cells=CELLS, num_peaks=4), SPECTRA),
    "corner_faces": (corner_faces, (STATES, _of(jnp.float32, 5, 3), _of(jnp.float32, 5, 3, 3))),
    "resample_nearest": (
        lambda v, a: ops.resample_nearest(v, a, target_shape=(8, 8, 8)),
        (STATES, AFFINE),
    ),
    "resample_trilinear": (
        lambda v, a: ops.resample_trilinear(v, a, target_shape=(8, 8, 8)),
        (_of(jnp.float32, 16, 16, 32), AFFINE),
    ),
}


@pytest.mark.filterwarnings("ignore:The Pallas Triton backend is deprecated:DeprecationWarning")
@pytest.mark.parametrize("name", KERNELS)
def test_public_kernels_are_lowered_for_cuda(name: str) -> None:
    kernel, shapes = KERNELS[name]
    text = lowered_for_cuda(kernel, *shapes)
    assert ("__gpu$xla.gpu.triton" in text) == ("pallas" in name)


def test_planes_of_occupancies_and_their_gradient_are_lowered_for_cuda() -> None:
    index = np.argwhere(np.ones((3, 4, 5), bool)).astype(np.int32)
    neighbours = neighbourhood(index, (3, 4, 5))

    def loss(occupancy: jax.Array) -> jax.Array:
        planes = soft_planes(occupancy, jnp.zeros((60, 3), jnp.float32), neighbours)
        sums = ball_sums(occupancy, neighbours)
        return jnp.sum(planes.offset, dtype=jnp.float32) + jnp.sum(sums, dtype=jnp.float32)

    assert lowered_for_cuda(jax.grad(loss), _of(jnp.float32, 60))


PART = (_of(jnp.uint8, 64, 8, 8, 8), _of(jnp.int32, 1024), _of(jnp.int32, 1, 3), _of(jnp.int32, 64, 3))
PLACE = ops.Block(np.asarray((64, 40, 32), np.int32), np.zeros(3, np.float32), np.asarray(0.1, np.float32))
IN_PARTS = {
    "classes_in_shards": (ops.classes_in_shards, (*PART, _of(jnp.int32))),
    "count_in_shards": (ops.count_in_shards, PART),
    "score_in_shards": (
        lambda blocks, *lists: ops.score_in_shards(ShardedCodes(blocks, PLACE), *lists),
        (*PART, POINTS, WEIGHTS, POSES),
    ),
}


@pytest.mark.parametrize("name", IN_PARTS)
def test_kernels_of_maps_in_parts_are_lowered_for_cuda(name: str) -> None:
    kernel, shapes = IN_PARTS[name]

    def of_one_part(
        pool: jax.Array, table: jax.Array, span: jax.Array, places: jax.Array, *others: jax.Array
    ) -> jax.Array:
        return kernel(ShardedBlocks(pool, table, span, places, (64, 40, 32), 2, mesh_of(1)), *others)

    # The mesh says where the kernel runs: `lowered_for_cuda` has one of its own.
    text = jax.export.export(jax.jit(of_one_part), platforms=("cuda",))(*shapes).mlir_module()
    assert not rounded_products(text)


def test_no_public_kernel_is_left_out() -> None:
    on_host = {
        "backward_affine",
        "connected_components",
        "gather_blocks",
        "gather_shards",
        "list_blocks",
        "map_shards",
        "map_tiles",
        "near_tiles",
        "point_tree",
        "shard_blocks",
        "shard_codes",
        "shard_grid",
    }
    within_others = {
        "count_steady_directions",
        "cut_blocks",
        "dense_from_blocks",
        "split_keys",
        "take_from_blocks",
    }
    named = {name.split()[0] for name in (*KERNELS, *IN_PARTS)}
    what_they_take = {"Block"}
    assert set(ops.__all__) <= named | on_host | within_others | what_they_take
