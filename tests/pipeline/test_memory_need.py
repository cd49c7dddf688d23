"""What registering takes, and who is told."""

import numpy as np
import pytest

import voxjax as vx
from voxjax import InputError, VoxelGrid
from voxjax.ops.blocks.block_builder import BlockBuilder
from voxjax.ops.evidence.translations import BATCH_BYTES
from voxjax.pipeline import many, memory_need, pair
from voxjax.pipeline.memory_need import MapSize, check_register_memory, content_size, register_memory

FIXED = register_memory([], 0.1)


def _grid(sides, *, known=None, voxel_size=0.1):
    """A block whose first `known` voxels along each axis are free, with an occupied floor."""
    states = np.zeros(sides, np.uint8)
    states[tuple(slice(side) for side in known or sides)] = 1
    states[: (known or sides)[0], : (known or sides)[1], 0] = 2
    return VoxelGrid(states, np.zeros(3, np.float32), voxel_size)


def _allow(monkeypatch, bytes_):
    monkeypatch.setenv("VOXJAX_MEMORY", str(bytes_ / 1e9))


def _need(*grids, voxel_size=0.1):
    return register_memory([content_size(grid) for grid in grids], voxel_size)


def test_what_fits_is_let_through_and_what_does_not_is_refused(monkeypatch):
    grids = [_grid((90, 80, 70)), _grid((60, 50, 40))]
    work = _need(*grids) - FIXED
    _allow(monkeypatch, FIXED + 1.01 * work)
    check_register_memory(grids, 0.1)
    _allow(monkeypatch, FIXED + 0.99 * work)
    with pytest.raises(InputError, match=r"registering maps .* needs about .* GB .* voxel size of 0\.2 m"):
        check_register_memory(grids, 0.1)


def test_only_the_box_around_what_is_known_counts(monkeypatch):
    inner = _grid((20, 30, 10))
    _allow(monkeypatch, FIXED + 1.01 * (_need(inner, inner) - FIXED))
    check_register_memory([_grid((300, 200, 100), known=(20, 30, 10))] * 2, 0.1)


def test_a_coarser_working_size_needs_less(monkeypatch):
    grids = [_grid((200, 200, 100))] * 2
    _allow(monkeypatch, FIXED + 0.9 * (_need(*grids) - FIXED))
    check_register_memory(grids, 0.2)
    with pytest.raises(InputError):
        check_register_memory(grids, 0.05)


def test_wide_maps_need_room_for_coarser_copies_and_for_the_search_in_them():
    building = MapSize((500, 500, 100), 300_000, 0.1, blocks=20_000)
    wide = building._replace(sides=(2500, 2500, 100))
    alone = register_memory([building] * 2, 0.1) - FIXED
    # Tables of the box aside, what the maps hold is the same.
    tables = 2 * (wide.at(0.1).kept - building.at(0.1).kept + wide.at(0.1).work - building.at(0.1).work)
    more = register_memory([wide] * 2, 0.1) - FIXED - alone - tables
    copies = 2 * wide.at(0.3).kept
    assert copies + BATCH_BYTES < more < copies + 3 * BATCH_BYTES


def test_maps_that_wait_cost_less_than_the_pair_at_work():
    size = MapSize((500, 500, 100), 300_000, 0.1)
    two, three, four = (register_memory([size] * n, 0.1) - FIXED for n in (2, 3, 4))
    assert four - three == pytest.approx(three - two)
    assert 0 < three - two < two / 2


def test_nothing_sensible_fits(monkeypatch):
    _allow(monkeypatch, 1e6)
    with pytest.raises(InputError, match="take a larger voxel size, crop the maps"):
        check_register_memory([_grid((9, 9, 9))] * 2, 0.1)


def test_a_map_of_unknown_voxels_needs_hardly_anything(monkeypatch):
    empty = VoxelGrid(np.zeros((200, 200, 200), np.uint8), np.zeros(3, np.float32), 0.1)
    _allow(monkeypatch, FIXED + 1e4)
    check_register_memory([empty, empty], 0.1)


@pytest.mark.parametrize("call", [lambda a, b: vx.register(a, b), lambda a, b: vx.merge([a, b])])
def test_the_pipeline_refuses_before_it_begins(monkeypatch, call):
    def never(*_: object, **__: object):
        raise AssertionError("features were computed")

    for module in (pair, many):
        monkeypatch.setattr(module, "features_at", never)
    _allow(monkeypatch, FIXED / 2)
    with pytest.raises(InputError, match="registering maps"):
        call(_grid((30, 30, 20)), _grid((20, 20, 20)))


@pytest.mark.parametrize("call", [vx.register, lambda a, b, **options: vx.merge([a, b], **options)])
def test_the_paper_s_method_is_refused_before_it_begins(monkeypatch, call):
    def never(*_: object, **__: object):
        raise AssertionError("corners were looked for")

    monkeypatch.setattr(pair, "register_paper", never)
    grids = _grid((30, 30, 20), voxel_size=0.1), _grid((20, 20, 20), voxel_size=0.2)
    _allow(monkeypatch, FIXED / 2)
    with pytest.raises(InputError, match=r"registering maps of together .* voxels of 0\.2 m needs about"):
        call(*grids, preset="paper")
    _allow(monkeypatch, 2 * FIXED)
    with pytest.raises(AssertionError, match="corners were looked for"):
        call(*grids, preset="paper")


def test_the_paper_s_window_counts_whole_maps(monkeypatch):
    grids = [_grid((300, 200, 100), known=(20, 30, 10))] * 2
    size = MapSize(grids[0].shape, grids[0].num_occupied, 0.1)
    window = register_memory([], 0.1, [size]) - FIXED
    # One map after the other, whatever is known of it; more than what features of what is known take.
    assert register_memory([], 0.1, [size, size]) - FIXED == window > 6e6 * 5
    _allow(monkeypatch, FIXED + 0.99 * window)
    check_register_memory(grids, 0.1)
    with pytest.raises(InputError, match=r"registering maps .* voxel size of 0\.2 m"):
        check_register_memory(grids, 0.1, preset="paper")
    _allow(monkeypatch, FIXED + 1.01 * window)
    check_register_memory(grids, 0.1, preset="paper")


@pytest.mark.parametrize("ask", [vx.register, lambda a, b, **options: vx.merge([a, b], **options)])
def test_more_voxels_than_32_bits_count_are_refused_before_the_work(ask):
    # Known corner to corner, and nothing between: no memory is asked for before the refusal.
    states = np.zeros((60, 60, 60), np.uint8)
    states[:3, :3, :3] = states[-3:, -3:, -3:] = 2
    grid = VoxelGrid(states, np.zeros(3, np.float32), 0.1)
    # Of 1500 x 1500 x 1500 voxels nothing is said, for only their blocks near surfaces are counted.
    with pytest.raises(
        InputError, match=r"a map at 0\.0009 m must have at most .* million occupied voxels .* got 74 million"
    ):
        ask(grid, grid, config={"map": {"voxel_size": 0.0009}})


def test_the_paper_s_method_is_bound_by_32_bits_too(monkeypatch):
    monkeypatch.setattr(memory_need, "MAX_ROWS", 1000)
    monkeypatch.setattr(memory_need, "check_pool", lambda *counts: pytest.fail(str(counts)))
    with pytest.raises(pytest.fail.Exception, match=r"a map at 0\.2 m"):
        vx.register(_grid((21, 22, 23)), _grid((20, 20, 20), voxel_size=0.2), preset="paper")


def test_an_extent_beyond_2_to_the_28_voxels_is_no_reason_to_refuse(monkeypatch):
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    monkeypatch.setattr(memory_need, "memory_limit", lambda: None)
    grid = _grid((46, 84, 8), voxel_size=10.0)
    check_register_memory([grid, grid], 0.5)


def _sparse(shape, pieces):
    """A map in blocks: pieces of a floor with free space above, each in a few blocks from a corner on."""
    builder = BlockBuilder(shape, np.uint8)
    piece = np.ones((1, 8, 8, 8), np.uint8)
    piece[..., 0] = 2
    for corner in pieces:
        places = np.argwhere(np.ones((6, 6, 1), bool)) + corner
        builder.add(places, np.broadcast_to(piece, (len(places), 8, 8, 8)))
    return VoxelGrid(builder.finish(), np.zeros(3), 0.1)


def test_what_is_in_the_box_counts_and_not_the_box(monkeypatch):
    # 3.1e9 voxels, of which pieces of 50 voxels are known, the farthest of them in the last corner.
    corners = [(10 * k, 13 * k, k) for k in range(30)]
    wide = _sparse((2700, 3400, 340), [*corners, (330, 418, 41)])
    wide_need = register_memory([content_size(wide)], 0.1) - FIXED
    # Beside the table and the one dense tile that is worked on, memory follows the pieces and the blocks around them.
    fixed = 8 * (338 * 426 * 43) + 4.5 * (1 << 24)
    of_piece = 4096 * 8 * 8 * 3 + 160 * 48 * 48
    assert wide_need - fixed < 31 * of_piece
    box = MapSize(wide.shape, wide.num_occupied, 0.1)
    assert wide_need < 0.02 * (register_memory([box], 0.1) - FIXED)
    # Two of them are searched in coarser copies, in blocks of few cells whatever the box.
    _allow(monkeypatch, FIXED + 2.5 * wide_need + 3 * BATCH_BYTES)
    check_register_memory([wide, wide], 0.1)
    _allow(monkeypatch, FIXED + 0.9 * wide_need)
    with pytest.raises(InputError, match=r"registering maps of together .* million voxels of 0\.1 m needs"):
        check_register_memory([wide, wide], 0.1)
