"""Programs kept between processes. `another_process` stands for one that knows nothing but what is in the folder."""

import hashlib
import json
import logging
import os
import pickle
import threading
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from voxjax import InputError, use_compilation_cache
from voxjax._runtime.program_files import KeptProgramWarning, last_used, read_whole
from voxjax._runtime.programs import keep_programs, kept_program
from voxjax.ops import Block, score_poses
from voxjax.refinement.residuals.terms import Level

VALUES = np.asarray([1.0, 2.0, 4.0], np.float32)


class Pair(NamedTuple):
    """A type of somebody else's: its code may change without a trace."""

    total: object
    largest: object


@pytest.fixture
def folder(tmp_path):
    keep_programs(tmp_path / "programs")
    yield tmp_path / "programs"
    keep_programs(None)


def another_process(folder):
    """Forget all programs and kernels; wait for what is loaded ahead."""
    jax.clear_caches()
    keep_programs(folder)
    for thread in threading.enumerate():
        if thread.name == "voxjax programs":
            thread.join()


def from_another_process(folder, function):
    """Results of a process of its own."""
    another_process(folder)
    return kept_program(function)(VALUES)


@pytest.fixture
def traced():
    """A function of an array and a static number, and how often it was traced."""
    count = []

    def scaled(values, *, times=2):
        count.append(times)
        return Level(jnp.sum(values, dtype=jnp.float32) * times, jnp.argmax(values))

    return jax.jit(scaled, static_argnames="times"), count


def test_the_second_process_traces_nothing(folder, traced):
    function, count = traced
    first = kept_program(function)(VALUES, times=3)
    assert (float(first.scale), int(first.number)) == (21.0, 2)
    assert isinstance(first, Level)
    another_process(folder)
    again = kept_program(function)(VALUES, times=3)
    assert isinstance(again, Level)
    assert (float(again.scale), int(again.number)) == (21.0, 2)
    assert count == [3]
    assert len(list(folder.iterdir())) == 1


def test_results_go_with_arrays_of_any_device(folder, traced):
    """Results of calls of exported programs are committed to a device; a kernel is compiled for these alone."""
    function, _ = traced
    found = kept_program(function)(VALUES)
    direct = function(VALUES)
    assert not direct.scale.committed
    assert [leaf.committed for leaf in jax.tree.leaves(found)] == [False, False]


def test_shapes_dtypes_and_numbers_have_programs_of_their_own(folder, traced):
    function, count = traced
    call = kept_program(function)
    calls = [(VALUES, 2), (VALUES[:2], 2), (VALUES.astype(np.int32), 2), (VALUES, 5)]
    for _ in range(2):
        found = [float(call(values, times=times).scale) for values, times in calls]
        assert found == [14.0, 6.0, 14.0, 35.0]
    assert count == [2, 2, 2, 5]
    assert len(list(folder.iterdir())) == 4


def test_kernels_are_ready_before_they_are_asked_for(folder, traced, caplog):
    function, _ = traced
    kept_program(function)(VALUES)
    another_process(folder)
    caplog.set_level(logging.WARNING)
    jax.config.update("jax_log_compiles", True)
    try:
        assert float(kept_program(function)(VALUES).scale) == 14.0
        assert not [record for record in caplog.records if "Compiling" in record.getMessage()]
        kept_program(function)(VALUES[:1])
        assert [record for record in caplog.records if "Compiling" in record.getMessage()]
    finally:
        jax.config.update("jax_log_compiles", False)


def test_an_error_while_tracing_is_the_caller_s(folder):
    def broken(values):
        raise ValueError("no such thing")

    call = kept_program(jax.jit(broken))
    for _ in range(2):
        with pytest.raises(ValueError, match="no such thing"):
            call(VALUES)
    assert not list(folder.iterdir())


def test_nothing_is_kept_unless_asked(tmp_path, traced):
    function, count = traced
    call = kept_program(function)
    call(VALUES)
    call(VALUES)
    assert len(count) == 1
    assert not list(tmp_path.iterdir())


def test_the_folder_of_kernels_has_the_programs(tmp_path, traced, monkeypatch):
    monkeypatch.setattr(jax.config, "update", lambda *_: None)  # other tests go on without a cache
    use_compilation_cache(tmp_path / "kernels")
    try:
        kept_program(traced[0])(VALUES)
    finally:
        keep_programs(None)
    assert len(list((tmp_path / "kernels" / "programs").iterdir())) == 1
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(InputError, match="cannot be kept in"):
        use_compilation_cache(blocked)


def test_transformations_see_the_function_itself(folder, traced):
    call = kept_program(traced[0])
    slope = jax.grad(lambda values: call(values, times=4).scale)(VALUES)
    np.testing.assert_array_equal(np.asarray(slope), [4.0, 4.0, 4.0])
    both = jax.vmap(lambda values: call(values).scale)(np.stack([VALUES, 2 * VALUES]))
    np.testing.assert_array_equal(np.asarray(both), [14.0, 28.0])
    assert float(jax.jit(lambda values: call(values).scale)(VALUES)) == 14.0
    assert not list(folder.iterdir())


def test_arguments_of_types_that_others_define_are_traced_in_each_process(folder):
    function = kept_program(jax.jit(lambda pair: pair.total + pair.largest))
    assert float(function(Pair(np.float32(1.0), np.float32(2.0)))) == 3.0

    class Module(eqx.Module):
        value: jax.Array

    other = kept_program(eqx.filter_jit(lambda module: module.value + 1))
    assert float(other(Module(jnp.float32(1.0)))) == 2.0
    assert not list(folder.iterdir())


@pytest.mark.parametrize(
    "damage", [lambda content: content[:-7], lambda _: b"", lambda c: c[:50] + b"?" + c[51:]]
)
def test_a_damaged_program_is_traced_again_and_replaced(folder, traced, damage):
    function, count = traced
    kept_program(function)(VALUES)
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(damage(whole))
    another_process(folder)
    assert float(kept_program(function)(VALUES).scale) == 14.0
    assert path.read_bytes() != damage(whole)
    another_process(folder)
    assert float(kept_program(function)(VALUES).scale) == 14.0
    assert len(count) == 2


def test_a_program_that_is_none_is_traced_again_and_nothing_in_it_runs(folder, traced, tmp_path):
    """A digest that fits proves that a file is whole, not that it is honest."""

    class Attack:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "was run"),)

    function, count = traced
    kept_program(function)(VALUES)
    (path,) = folder.iterdir()
    honest = path.read_bytes()[32:]
    header = json.dumps({"name": "f", "is_double": False, "results": "array"}).encode()
    length = len(header).to_bytes(4, "little")
    for hostile in (
        pickle.dumps(Attack()),
        length + header + pickle.dumps(Attack()),
        length + header,
        b"\xff" * 4 + header,
        honest.replace(b'"Level"', b'"Lever"'),
        b"",
    ):
        path.write_bytes(hashlib.sha256(hostile).digest() + hostile)
        another_process(folder)
        assert float(kept_program(function)(VALUES).scale) == 14.0
        assert path.read_bytes()[32:] != hostile
    assert len(count) == 7
    assert not (tmp_path / "was run").exists()


def test_a_program_that_others_can_have_written_is_not_used(folder, traced):
    function, count = traced
    kept_program(function)(VALUES)
    (path,) = folder.iterdir()
    path.chmod(0o666)
    with pytest.warns(KeptProgramWarning, match="can be written by others"):
        assert float(from_another_process(folder, function).scale) == 14.0
    assert len(count) == 2
    assert path.stat().st_mode & 0o777 == 0o600


def test_links_and_files_that_vanish_cost_one_trace_and_no_traceback(folder, traced, monkeypatch):
    function, count = traced
    kept_program(function)(VALUES)
    (path,) = folder.iterdir()
    path.unlink()
    path.symlink_to(folder / "nowhere")
    gone = folder / "gone.program"
    monkeypatch.setattr(type(folder), "glob", lambda *_: [gone, path])
    assert last_used(folder) == [path]
    assert read_whole(gone) is None
    with pytest.warns(KeptProgramWarning, match="not used"):
        assert float(from_another_process(folder, function).scale) == 14.0
    assert len(count) == 2
    assert path.is_file()
    assert not path.is_symlink()
    assert not (folder / "nowhere").exists()


def test_results_of_other_types_are_traced_in_each_process(folder):
    function = kept_program(jax.jit(lambda values: Pair(values.sum(dtype=values.dtype), values.max())))
    assert float(function(VALUES).total) == 7.0
    assert not list(folder.iterdir())


def test_a_folder_that_is_gone_is_said_and_stops_nothing(folder, traced):
    folder.rmdir()
    with pytest.warns(UserWarning, match="programs cannot be kept in"):
        found = kept_program(traced[0])(VALUES)
    assert float(found.scale) == 14.0


def test_double_precision_has_a_program_of_its_own(folder, traced):
    call = kept_program(traced[0])
    call(VALUES)
    with jax.enable_x64(True):
        assert float(call(VALUES.astype(np.float64)).scale) == 14.0
        assert float(call(VALUES).scale) == 14.0
    assert len(list(folder.iterdir())) == 3


def test_kernels_give_the_same_bits_with_and_without_a_program(folder):
    rng = np.random.default_rng(0)
    codes, dims = rng.integers(0, 4, 20 * 21 * 22).astype(np.uint8), np.asarray([20, 21, 22], np.int32)
    points, weights = rng.uniform(0, 2, (700, 3)).astype(np.float32), rng.random(700).astype(np.float32)
    poses = np.tile(np.eye(4, dtype=np.float32), (6, 1, 1))
    poses[:, :3, 3] = rng.normal(0, 0.3, (6, 3))

    block = Block.of(dims, np.zeros(3, np.float32), 0.1)

    def scores():
        return np.asarray(score_poses(codes, block, points, weights, poses))

    kept = scores()
    assert len(list(folder.iterdir())) == 1
    another_process(folder)
    loaded = scores()
    keep_programs(None)
    np.testing.assert_array_equal(scores(), kept)
    np.testing.assert_array_equal(loaded, kept)
    assert kept.min() > 0
