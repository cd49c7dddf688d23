"""Arguments of the command line."""

import argparse
import subprocess
import sys

import pytest

from command_line import one_line
from voxjax.cli.parser import (
    memory_size,
    parse,
    positive_number,
    process_count,
    three_numbers,
    whole_number,
)


def test_help_imports_neither_jax_nor_numpy():
    code = (
        "import sys; from voxjax.cli.main import main; code = main(sys.argv[1:]); "
        "sys.exit(code or sum(name in sys.modules for name in ('jax', 'numpy', 'equinox', 'scipy')))"
    )
    for arguments in (["--help"], ["merge", "--help"], ["--version"]):
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert "voxjax" in done.stdout


def test_processes_are_one_or_more():
    assert process_count("4") == 4
    with pytest.raises(argparse.ArgumentTypeError, match="must be a whole number, 1 or more, got '0'"):
        process_count("0")


@pytest.mark.parametrize("text", ["", " ", "nan", "inf", "-inf", "0", "-0", "-1", "1e400", "one", "9" * 5000])
def test_lengths_are_finite_and_above_zero(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be a number above 0, got"):
        positive_number(text)


@pytest.mark.parametrize("text", ["", "1,2", "1,2,3,4", "1,2,x", "1,2,nan", "inf,0,0", "1 2 3"])
def test_shifts_are_three_finite_numbers(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be three numbers x,y,z, got"):
        three_numbers(text)


@pytest.mark.parametrize("text", ["", "nan", "-1", "1.5", str(2**63), "9" * 5000])
def test_seeds_are_whole_numbers_of_64_bits(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be a whole number from 0"):
        whole_number(text)


def test_numbers_are_taken():
    assert positive_number("1e-3") == 0.001
    assert three_numbers("-1,2e5,0.25") == (-1.0, 2e5, 0.25)
    assert whole_number("9223372036854775807") == 2**63 - 1


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["merge", "a.bt", "b.bt", "-o", "c.bt", "--init-guess", "-1,0,0"], "write --init-guess=..."),
        (["convert", "a.bt", "b.bt", "--shift", "-1,0,0"], "write --shift=..."),
        (["merge", "a.bt", "b.bt", "fused.bt"], "did you mean -o fused.bt?"),
        (["corners", "a.bt", "c.csv"], "did you mean -o c.csv?"),
        (["merge", "a.bt", "here.bt"], "required: -o/--output (see: voxjax merge --help)"),
    ],
)
def test_common_slips_get_a_hint(folder, capsys, arguments, hint):
    (folder / "here.bt").touch()
    with pytest.raises(SystemExit) as stop:
        parse(arguments)
    assert stop.value.code == 2
    assert hint in one_line(capsys)


@pytest.mark.parametrize("option", ["--report", "--config", "--init-guess"])
def test_an_option_without_a_value_is_refused(capsys, option):
    with pytest.raises(SystemExit) as stop:
        parse(["merge", "a.bt", "b.bt", "-o", "c.bt", f"{option}=--"])
    assert stop.value.code == 2
    assert f"argument {option}" in one_line(capsys)


@pytest.mark.parametrize(
    ("text", "gigabytes"), [("2G", 2.0), ("500M", 0.5), ("1.5g", 1.5), ("3", 3.0), ("2 GB", 2.0)]
)
def test_sizes_of_memory_are_taken(text, gigabytes):
    assert memory_size(text) == gigabytes


@pytest.mark.parametrize("text", ["G", "", "2T", "-1G", "nan", "0M", "infG"])
def test_other_sizes_are_refused_with_an_example(text):
    with pytest.raises(argparse.ArgumentTypeError, match="must be a size such as 2G or 500M, got"):
        memory_size(text)
