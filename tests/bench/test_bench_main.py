"""The command `python -m bench`: what it lists, and what it says of a name that it does not know."""

import importlib

from bench import __main__ as command


def test_every_benchmark_is_listed_with_a_sentence(capsys):
    known = command.benchmarks()
    assert {"registration", "refinement", "kernels", "docs"} <= set(known)
    assert "timing" not in known
    assert all(sentence.endswith((".", "?")) for sentence in known.values())
    assert command.main([]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed and sentence in printed for name, sentence in known.items())


def test_run_times_are_listed_where_they_are_known(capsys):
    times = command.run_times()
    assert {"docs", "stores", "fuzz"} <= set(times) < set(command.benchmarks())
    assert all(text.startswith("about ") for text in times.values())
    assert command.main(["--help"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert all(lines[name].endswith(f"[{text}]") for name, text in times.items())
    assert not lines["verdict_fit"].endswith("]")
    assert "two cores" in lines["Times"]


def test_an_unknown_name_is_exit_code_2(capsys):
    assert command.main(["no_such_benchmark"]) == 2
    assert "registration" in capsys.readouterr().err


def test_the_named_benchmark_gets_the_other_arguments(monkeypatch):
    seen = []
    monkeypatch.setattr(importlib.import_module("bench.docs"), "main", lambda argv: seen.append(argv))
    assert command.main(["docs", "--check"]) == 0
    assert seen == [["--check"]]
