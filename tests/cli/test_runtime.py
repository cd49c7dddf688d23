"""Compiled kernels kept between processes: where, what, and what happens when they cannot be."""

import os

import pytest

from cache_runs import COMMAND, COUNTED, kernel_entries, run_process
from voxjax._runtime.memory import memory_limit
from voxjax.cli.runtime import granted_memory


@pytest.mark.parametrize("choice", [{}, {"VOXJAX_CACHE": "off"}, {"JAX_COMPILATION_CACHE_DIR": "mine"}])
def test_the_cache_goes_to_the_user_s_cache_folder_unless_told_otherwise(tmp_path, choice):
    code = (
        "import jax; from voxjax.cli.runtime import kept_kernels\n"
        "with kept_kernels(): print(jax.config.jax_compilation_cache_dir)"
    )
    shown, _ = run_process(code, tmp_path, **choice)
    expected = {"VOXJAX_CACHE": "None", "JAX_COMPILATION_CACHE_DIR": "mine"}
    assert shown == [next((expected[name] for name in choice), str(tmp_path / "voxjax" / "xla"))]


def test_the_second_process_compiles_nothing_however_fast_it_was_compiled(tmp_path):
    assert run_process(COMMAND, tmp_path) == (["15.0", "0 1"], "")
    assert run_process(COMMAND, tmp_path) == (["15.0", "1 0"], "")


def test_thresholds_of_the_environment_win(tmp_path):
    variables = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "1000"}
    assert run_process(COMMAND, tmp_path, **variables) == (["15.0", "0 0"], "")
    assert kernel_entries(tmp_path) == []


def test_a_cache_that_the_user_named_is_filled_too(tmp_path):
    mine = tmp_path / "mine"
    assert run_process(COMMAND, tmp_path, JAX_COMPILATION_CACHE_DIR=str(mine)) == (["15.0", "0 1"], "")
    assert list(mine.glob("*-cache"))


@pytest.mark.parametrize(
    "damage", [lambda data: b"not a kernel", lambda data: data[: len(data) // 2], lambda data: b""]
)
def test_a_damaged_kernel_is_compiled_again_and_replaced(tmp_path, damage):
    run_process(COMMAND, tmp_path)
    (entry,) = kernel_entries(tmp_path)
    entry.write_bytes(damage(entry.read_bytes()))
    assert run_process(COMMAND, tmp_path) == (["15.0", "0 1"], "")
    assert run_process(COMMAND, tmp_path) == (["15.0", "1 0"], "")


def test_without_a_folder_the_command_runs_and_says_so_in_one_line(tmp_path):
    file = tmp_path / "file"
    file.write_text("")
    shown, said = run_process(COMMAND, file)
    assert shown == ["15.0", "0 0"]
    (line,) = said.splitlines()
    assert line.startswith("voxjax: compiled kernels cannot be kept in ")
    assert "XDG_CACHE_HOME" in line


def test_a_folder_that_vanishes_is_said_once_and_the_command_runs(tmp_path):
    code = f"""
{COUNTED}
from voxjax.cli.runtime import kept_kernels
import shutil
with kept_kernels():
    float(jax.jit(lambda x: x + 1)(1))
    shutil.rmtree({str(tmp_path / "voxjax")!r})
    print([float(jax.jit(lambda x: x + n)(1)) for n in (2, 3)])
"""
    shown, said = run_process(code, tmp_path)
    assert shown == ["[3.0, 4.0]"]
    (line,) = said.splitlines()
    assert "cannot be kept" in line


def test_other_warnings_are_still_shown(tmp_path):
    code = "import warnings; from voxjax.cli.runtime import kept_kernels\nwith kept_kernels(): warnings.warn('look')"
    assert "UserWarning: look" in run_process(code, tmp_path)[1]


def test_fifty_damaged_kernels_and_programs_cost_their_compilation_and_no_word(tmp_path):
    kernels = f"""
{COUNTED}
from voxjax._runtime.programs import kept_program
from voxjax.cli.runtime import kept_kernels
kept = kept_program(jax.jit(lambda x: x * 2))
with kept_kernels():
    print(sum(float(kept(np.ones(n, np.float32))[0]) for n in range(1, 51)))
    print(events.count("cache_misses") >= 50, events.count("cache_misses") == 0)
"""
    assert run_process(kernels, tmp_path) == (["100.0", "True False"], "")
    programs = list((tmp_path / "voxjax" / "xla" / "programs").iterdir())
    assert len(programs) == 50
    assert len(kernel_entries(tmp_path)) >= 50
    for number, path in enumerate([*kernel_entries(tmp_path), *programs]):
        path.write_bytes(path.read_bytes()[: 100 * (number % 3)])
    assert run_process(kernels, tmp_path) == (["100.0", "True False"], "")
    assert run_process(kernels, tmp_path) == (["100.0", "False True"], "")


@pytest.mark.parametrize("variable", ["XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR"])
def test_a_folder_that_others_can_write_is_not_used_and_named_in_one_line(tmp_path, variable):
    folder = tmp_path if variable.startswith("JAX") else tmp_path / "voxjax" / "xla"
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o777)
    shown, said = run_process(COMMAND, tmp_path, **{variable: str(tmp_path)})
    assert shown == ["15.0", "0 0"]
    (line,) = said.splitlines()
    assert "can be written by others" in line
    assert f"set {variable} to another folder" in line
    assert list(folder.iterdir()) == []


def test_a_relative_cache_home_is_ignored_and_said_in_one_line(tmp_path):
    variables = {"XDG_CACHE_HOME": "relative", "HOME": str(tmp_path)}
    shown, said = run_process(COMMAND, tmp_path, **variables)
    assert shown == ["15.0", "0 1"]
    (line,) = said.splitlines()
    assert "'relative'" in line
    (entry,) = (tmp_path / ".cache" / "voxjax" / "xla").glob("*-cache")
    assert entry.is_file()


@pytest.mark.parametrize("before", [None, "7"])
def test_memory_is_granted_for_a_run_and_no_longer(monkeypatch, before):
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    if before is not None:
        monkeypatch.setenv("VOXJAX_MEMORY", before)
    limit = memory_limit(on_device=False)
    with granted_memory(None):
        assert before is None or memory_limit() == limit
    seen = []

    def work():
        seen.append(memory_limit())
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), granted_memory(0.5):
        work()
    assert seen == [0.5e9]
    assert os.environ.get("VOXJAX_MEMORY") == before
