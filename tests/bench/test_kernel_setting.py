"""What a benchmark of kernels says of where it ran."""

import pytest

from bench import kernel_setting


@pytest.mark.parametrize(
    ("variable", "value", "expected"),
    [
        ("GLIBC_TUNABLES", "glibc.malloc.hugetlb=1:glibc.malloc.mmap_max=0", "tuned"),
        ("LD_PRELOAD", "/some/where/libjemalloc.so.2", "tuned"),
        ("GLIBC_TUNABLES", "glibc.malloc.perturb=0", "default"),
    ],
)
def test_the_allocator_is_told_from_the_environment(monkeypatch, variable, value, expected):
    for name in ("GLIBC_TUNABLES", "LD_PRELOAD"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(variable, value)
    assert kernel_setting.allocator() == expected
    assert "/some/where" not in str(kernel_setting.describe())


def test_names_of_files_are_plain():
    assert kernel_setting.file_name("AMD EPYC(TM) 9B45, 2 cores") == "amd-epyc-tm-9b45-2-cores.json"
