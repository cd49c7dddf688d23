"""The progress display."""

import io
import os
import subprocess
import sys

import pytest

from voxjax.cli.runtime import Progress


class _Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_file_gets_one_line_a_stage_that_has_ended():
    stream = io.StringIO()
    progress = Progress(stream=stream)
    progress("read")
    progress("merge", "more", 3)
    assert [line.split(" s  ")[1] for line in stream.getvalue().splitlines()] == ["read"]
    progress.finish()
    progress.finish()
    assert [line.split(" s  ")[1] for line in stream.getvalue().splitlines()] == ["read", "merge"]
    assert set(progress.seconds) == {"read", "merge"}


def test_a_terminal_also_sees_the_running_stage():
    stream = _Terminal()
    Progress(stream=stream)("read")
    assert "read ..." in stream.getvalue()


def test_quiet_writes_nothing_but_keeps_the_seconds():
    stream = io.StringIO()
    progress = Progress(quiet=True, stream=stream)
    progress("read")
    progress.finish()
    assert stream.getvalue() == ""
    assert progress.seconds["read"] >= 0.0


@pytest.mark.parametrize("choice", [{}, {"VOXJAX_CACHE": "off"}, {"JAX_COMPILATION_CACHE_DIR": "mine"}])
def test_the_compilation_cache_goes_to_the_user_s_cache_folder_unless_told_otherwise(tmp_path, choice):
    code = (
        "import jax; from voxjax.cli.runtime import use_compilation_cache as use; use(); "
        "print(jax.config.jax_compilation_cache_dir)"
    )
    environment = {
        "PATH": os.environ["PATH"],
        "XDG_CACHE_HOME": str(tmp_path),
        "JAX_PLATFORMS": "cpu",
        **choice,
    }
    command = [sys.executable, "-c", code]
    shown = subprocess.run(command, env=environment | choice, capture_output=True, text=True, check=True)
    expected = {"VOXJAX_CACHE": "None", "JAX_COMPILATION_CACHE_DIR": "mine"}
    default = str(tmp_path / "voxjax" / "xla")
    assert shown.stdout.strip() == next((expected[name] for name in choice), default)
