"""Soft fusion: the nearest path on aligned lattices, a loop of NumPy elsewhere, derivatives in both modes."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import voxjax as vx
from oracles import resampling as oracle
from oracles.motions import turned
from voxjax import InputError, VoxelGrid, rigid

SIZE = 0.1
I = np.eye(4)
LIMITS = (-2.0, 3.51)


def make_grid(seed=0, shape=(6, 5, 4), low=(0, 0, 0), with_log_odds=True, dtype=np.float32) -> VoxelGrid:
    rng = np.random.default_rng(seed)
    states = rng.integers(0, 3, shape).astype(np.uint8)
    log_odds = np.array([0, -1, 1])[states] * rng.uniform(0.1, 1.5, shape)
    values = jnp.asarray(log_odds, dtype) if with_log_odds else None
    return VoxelGrid(states, np.asarray(low) * SIZE, SIZE, values)


def with_log_odds(grid: VoxelGrid, log_odds) -> VoxelGrid:
    return VoxelGrid(grid.states, grid.origin, grid.voxel_size, log_odds)


def pose(turn=(0.4, 0.2, -0.1), shift=(0.13, -0.07, 0.02)) -> np.ndarray:
    return turned("zyx", turn, shift)


def soft(grids, poses, onto=None) -> VoxelGrid:
    return vx.fuse(grids, poses, interpolation="trilinear", onto=onto)


def odds(fused: VoxelGrid) -> Any:
    assert fused.log_odds is not None
    return fused.log_odds


@pytest.mark.parametrize("shift", [(0, 0, 0), (2, -1, 3), (40, 0, 0)])
@pytest.mark.parametrize("has_odds", [True, False])
def test_aligned_lattices_fuse_as_without_interpolation(shift, has_odds):
    a, b = make_grid(1, with_log_odds=has_odds), make_grid(2, (4, 7, 5), (-3, 1, 2), has_odds)
    T = pose((0, 0, 0), np.asarray(shift) * SIZE)
    fused, nearest = soft([a, b], [I, T]), vx.fuse([a, b], [I, T], rule="log_odds")
    np.testing.assert_array_equal(fused.states, nearest.states)
    np.testing.assert_array_equal(fused.origin, nearest.origin)
    np.testing.assert_allclose(np.clip(np.asarray(odds(fused)), *LIMITS), odds(nearest), atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("coarse", [1.0, 2.5])
def test_any_poses_fuse_as_the_loop_onto_any_lattice(seed, coarse):
    rng = np.random.default_rng(seed)
    grids = [make_grid(seed), make_grid(seed + 9, (3, 4, 6), (1, -2, 0))]
    grids[1] = VoxelGrid(grids[1].states, grids[1].origin, SIZE * coarse, grids[1].log_odds)
    poses = [pose(rng.uniform(-3, 3, 3), rng.uniform(-0.2, 0.2, 3)) for _ in grids]
    onto = VoxelGrid(np.zeros((9, 8, 11), np.uint8), [-0.513, -0.2, -0.44], SIZE)
    expected, is_known = np.zeros(onto.shape), np.zeros(onto.shape, bool)
    for grid, T in zip(grids, poses, strict=True):
        R, t = T[:3, :3], T[:3, 3]
        offset = (R.T @ (np.asarray(onto.origin, np.float64) - t) - grid.origin) / grid.voxel_size
        affine = np.concatenate([R.T * (SIZE / grid.voxel_size), offset[:, None]], axis=1)
        expected += oracle.trilinear(np.asarray(grid.log_odds), affine, onto.shape)
        centres = np.stack(np.meshgrid(*(np.arange(n) + 0.5 for n in onto.shape), indexing="ij"), axis=-1)
        cell = np.floor(centres @ affine[:, :3].T + affine[:, 3]).astype(int)
        inside = ((cell >= 0) & (cell < grid.shape)).all(axis=-1)
        is_known[inside] |= np.asarray(grid.states)[tuple(cell[inside].T)] != 0
    fused = soft(grids, poses, onto)
    assert fused.shape == onto.shape
    np.testing.assert_array_equal(fused.origin, onto.origin)
    np.testing.assert_allclose(odds(fused), expected, atol=1e-4)
    states = np.where(is_known, np.where(expected >= 0, 2, 1), 0)
    assert np.mean(np.asarray(fused.states) != states) < 0.005  # centres on borders of voxels may round

    traced = jax.jit(lambda poses: soft(grids, poses, onto))([jnp.asarray(T, jnp.float32) for T in poses])
    np.testing.assert_allclose(odds(traced), expected, atol=1e-4)
    assert np.mean(np.asarray(traced.states) != states) < 0.005


def test_the_order_of_maps_does_not_matter():
    a, b = make_grid(1), make_grid(2, (4, 7, 5))
    assert soft([a, b], [I, pose()]) == soft([b, a], [pose(), I])


def test_unknown_neighbours_weaken_a_surface_and_turn_no_sign():
    states = np.zeros((6, 3, 3), np.uint8)
    states[2], states[3] = 2, 1
    wall = VoxelGrid(states, np.zeros(3), SIZE, np.array([0, -1, 1], np.float32)[states])
    onto = VoxelGrid(np.zeros((6, 1, 1), np.uint8), [0, SIZE, SIZE], SIZE)
    values = np.asarray(odds(soft([wall], [pose((0, 0, 0), (0.025, 0, 0))], onto)))[:, 0, 0]
    np.testing.assert_allclose(values, [0, 0, 0.75, -0.5, -0.25, 0], atol=1e-5)


def sum_of_products(dtype):
    """A loss that no symmetry makes stationary, of pose tangents and log-odds of two maps."""
    a, b = make_grid(3), make_grid(4, (5, 4, 6))
    onto = VoxelGrid(np.zeros((7, 6, 5), np.uint8), np.full(3, -0.03), SIZE)
    weights = np.random.default_rng(5).normal(size=onto.shape).astype(dtype)

    def loss(tangent, odds_a, odds_b):
        T = jnp.asarray(pose(), dtype) @ rigid.exp(tangent)
        fused = odds(soft([with_log_odds(a, odds_a), with_log_odds(b, odds_b)], [I, T], onto))
        assert fused.dtype == dtype
        return jnp.sum(weights * jnp.sin(fused), dtype=dtype)

    return jax.jit(loss), (
        jnp.zeros(6, dtype),
        jnp.asarray(a.log_odds, dtype),
        jnp.asarray(b.log_odds, dtype),
    )


@pytest.mark.parametrize("is_double", [True, False])
def test_derivatives_in_pose_and_log_odds_are_those_of_differences(is_double):
    dtype, step, tolerance = (np.float64, 1e-7, 1e-4) if is_double else (np.float32, 1e-3, 0.05)
    with jax.enable_x64(is_double):
        loss, at = sum_of_products(dtype)
        gradients = jax.grad(loss, argnums=(0, 1, 2))(*at)
        rng = np.random.default_rng(6)
        for number, gradient in enumerate(gradients):
            assert gradient.dtype == dtype
            assert np.abs(np.asarray(gradient)).max() > 0.1
            direction = jnp.asarray(rng.normal(size=gradient.shape), dtype)
            direction = direction / jnp.linalg.norm(direction)
            ends = [
                float(
                    loss(*(x + s * dtype(step) * direction if n == number else x for n, x in enumerate(at)))
                )
                for s in (dtype(1), dtype(-1))
            ]
            slope = (ends[0] - ends[1]) / (2 * step)
            backward = float(jnp.sum(gradient * direction))
            tangents = tuple(direction if n == number else jnp.zeros_like(x) for n, x in enumerate(at))
            _, forward = jax.jvp(loss, at, tangents)
            np.testing.assert_allclose(backward, slope, rtol=tolerance, atol=tolerance)
            np.testing.assert_allclose(forward, backward, rtol=tolerance * 0.1, atol=tolerance * 0.1)


@pytest.mark.parametrize(
    "T",
    [I, np.diag([-1.0, -1.0, 1.0, 1.0]), pose((0, 0, 0), (50, 0, 0))],
    ids=["identity", "half-turn", "no overlap"],
)
def test_derivatives_are_finite_where_poses_are_special(T):
    a, b = make_grid(1), make_grid(2)
    onto = VoxelGrid(np.zeros((6, 5, 4), np.uint8), np.zeros(3), SIZE)

    def loss(tangent, log_odds, T):
        moved = rigid.exp(tangent) @ T
        fused = odds(soft([a, with_log_odds(b, log_odds)], [I, moved], onto))
        return jnp.sum(fused**2, dtype=jnp.float32)

    @jax.jit
    def derivatives(T):
        at = jnp.zeros(6, jnp.float32), jnp.asarray(b.log_odds)
        _, forward = jax.jvp(
            lambda twist, odds: loss(twist, odds, T), at, tuple(jnp.ones_like(x) for x in at)
        )
        return *jax.grad(loss, argnums=(0, 1))(*at, T), forward

    for gradient in derivatives(jnp.asarray(T, jnp.float32)):
        assert np.isfinite(np.asarray(gradient)).all()
        if T[0, 3] == 50:
            assert not np.asarray(gradient).any()


def test_maps_of_nothing_fuse_to_nothing():
    empty = VoxelGrid(np.zeros((3, 3, 3), np.uint8), np.zeros(3), SIZE, np.zeros((3, 3, 3), np.float32))
    no_voxels = VoxelGrid(np.zeros((0, 3, 3), np.uint8), np.zeros(3), SIZE)
    assert soft([no_voxels], [pose()]).shape == (1, 1, 1)
    fused = soft([empty, no_voxels], [I, pose()])
    assert fused.shape == empty.shape
    assert fused.num_occupied + fused.num_free == 0
    onto = make_grid()
    fused = soft([empty, no_voxels], [I, pose()], onto)
    assert not np.asarray(odds(fused)).any()


def test_descending_the_disagreement_brings_a_shifted_map_back():
    """Evidence of equal sign adds up, of opposite sign cancels: the sum of squares is largest where maps agree."""
    grid = np.stack(np.meshgrid(*3 * [np.arange(20.0)], indexing="ij"), axis=-1) - 9.5
    r_sq = (grid**2 / [6, 8, 10]).sum(axis=-1)
    log_odds = (3 * np.exp(-r_sq) - 1.5 * np.exp(-r_sq / 2)).astype(np.float32)
    pillar = VoxelGrid(np.where(log_odds >= 0, 2, 1).astype(np.uint8), np.full(3, -10 * SIZE), SIZE, log_odds)
    onto = VoxelGrid(np.zeros((24, 24, 24), np.uint8), np.full(3, -12 * SIZE), SIZE)

    def loss(tangent):
        fused = odds(soft([pillar, pillar], [I, rigid.exp(tangent)], onto))
        return -jnp.sum(fused**2, dtype=jnp.float32) / jnp.sum(log_odds**2, dtype=jnp.float32)

    descend = jax.jit(lambda x, rate: x - rate * jax.grad(loss)(x))
    tangent = jnp.asarray([SIZE, 0, 0, 0, 0, 0], jnp.float32)
    for step in range(60):  # shorter and shorter, because interpolation leaves a kink at the optimum
        tangent = descend(tangent, jnp.float32(5e-3 * 0.95**step))
    assert np.linalg.norm(np.asarray(tangent)[:3]) < 0.1 * SIZE


def test_misuse_is_refused_in_one_sentence(monkeypatch):
    grid, fine = make_grid(), make_grid().with_voxel_size(SIZE / 2)
    T = jnp.eye(4, dtype=jnp.float32)

    def call(**options):
        options = {"interpolation": "trilinear", "onto": None, **options}
        return lambda: vx.fuse([grid], [I], **options)

    def of_odds(log_odds):
        return soft([with_log_odds(fine, log_odds)], [I], grid).log_odds

    for refused, sentence in (
        (call(interpolation="cubic"), "interpolation must be one of"),
        (call(rule="keep"), 'is for rule="log_odds"'),
        (call(interpolation="nearest", onto=grid), "onto is for"),
        (call(onto=grid, voxel_size=SIZE), "voxel_size must be None"),
        (lambda: soft([grid], [np.diag([1, 1, -1, 1])]), r"poses\[0\] must be a rigid"),
        (lambda: jax.jit(lambda T: soft([grid], [T]).log_odds)(T), "onto must be given"),
        (
            lambda: jax.jit(lambda T: soft([grid], [T[:3]], grid).log_odds)(T),
            r"poses\[0\] must be a \(4, 4\)",
        ),
        (lambda: jax.jit(of_odds)(jnp.asarray(fine.log_odds)), "coarsen it first"),
        (lambda: jax.jit(lambda g: soft([g], [I], grid).log_odds)(grid), "must not be traced"),
    ):
        with pytest.raises(InputError, match=sentence):
            refused()
    monkeypatch.setenv("VOXJAX_MEMORY", "0.1")
    with pytest.raises(InputError, match="a soft fused map of 6 x 5 x 4 voxels needs about"):
        soft([grid], [I], grid)


def test_maps_in_blocks_fuse_as_dense_ones():
    grids = [make_grid(1, (17, 9, 12)), make_grid(2, (12, 20, 7), with_log_odds=False)]
    sparse = [VoxelGrid(g.state_blocks(), g.origin, SIZE, g.log_odds_blocks()) for g in grids]
    assert soft(sparse, [I, pose()]) == soft(grids, [I, pose()])
