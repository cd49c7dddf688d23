"""How much memory there is, by system files that a test writes itself, and the refusal."""

import os

import jax
import pytest

from voxjax import InputError
from voxjax._runtime import memory as _memory
from voxjax._runtime.memory import available_memory, check_memory, device_memory, memory_limit

MEMINFO = "MemTotal:  1000 kB\nMemAvailable:    600 kB\nHugePages_Total:  0\nSwapFree:   100 kB\n"


def _write(root, files):
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)


def test_the_machine_s_memory_counts_free_swap(tmp_path):
    _write(tmp_path, {"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/\n"})
    assert available_memory(tmp_path) == 700 * 1024


@pytest.mark.parametrize("limited", ["a", "a/b"])
def test_a_control_group_bounds_what_is_below_it(tmp_path, limited):
    groups = "sys/fs/cgroup"
    files = {"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/a/b\n"}
    for folder in ("a", "a/b"):
        files |= {
            f"{groups}/{folder}/memory.max": "50000\n" if folder == limited else "max\n",
            f"{groups}/{folder}/memory.current": "20000\n",
            f"{groups}/{folder}/memory.stat": "anon 7000\ninactive_file 5000\n",
        }
    _write(tmp_path, files)
    assert available_memory(tmp_path) == 50000 - 20000 + 5000


def test_the_first_version_of_control_groups(tmp_path):
    # In a container the path names a group of the host, and the limit stands at the mount.
    files = {
        "proc/meminfo": MEMINFO,
        "proc/self/cgroup": "3:cpu,cpuacct:/host/x\n2:memory:/host/x\n",
        "sys/fs/cgroup/memory/memory.limit_in_bytes": "40000\n",
        "sys/fs/cgroup/memory/memory.usage_in_bytes": "30000\n",
        "sys/fs/cgroup/memory/memory.stat": "total_inactive_file 1000\n",
    }
    _write(tmp_path, files)
    assert available_memory(tmp_path) == 11000


def test_a_group_over_its_limit_leaves_nothing(tmp_path):
    files = {"memory.max": "100\n", "memory.current": "300\n"}
    _write(tmp_path, {f"sys/fs/cgroup/{name}": text for name, text in files.items()})
    _write(tmp_path, {"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/\n"})
    assert available_memory(tmp_path) == 0


@pytest.mark.parametrize("names", [{"SC_AVPHYS_PAGES": 0}, {"SC_PHYS_PAGES": 1}, {}])
def test_elsewhere_the_system_is_asked_for_its_pages(tmp_path, monkeypatch, names):
    monkeypatch.setattr(os, "sysconf_names", names)
    monkeypatch.setattr(os, "sysconf", {"SC_AVPHYS_PAGES": 3, "SC_PHYS_PAGES": 5, "SC_PAGE_SIZE": 7}.get)
    expected = {"SC_AVPHYS_PAGES": 21, "SC_PHYS_PAGES": 35}
    assert available_memory(tmp_path) == next((expected[name] for name in names), None)


def test_this_machine_says_how_much_it_has():
    found = available_memory()
    assert found is None or found > 1_000_000


def test_the_refusal_names_need_limit_and_remedy(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "2.5")
    check_memory(2.5e9, "fusing", "crop the maps")
    with pytest.raises(InputError) as refusal:
        check_memory(3.1e9, "fusing", "crop the maps")
    expected = "fusing needs about 3.1 GB of memory and 2.5 GB are available; crop the maps"
    assert str(refusal.value) == f"{expected}; VOXJAX_MEMORY=off skips this check."


def test_the_check_can_be_switched_off(monkeypatch):
    monkeypatch.setenv("VOXJAX_MEMORY", "off")
    check_memory(1e30, "fusing", "crop the maps")


def test_where_nothing_is_known_nothing_is_refused(monkeypatch):
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    monkeypatch.setattr(_memory, "available_memory", lambda: None)
    assert memory_limit() is None
    check_memory(1e30, "fusing", "crop the maps")


@pytest.mark.parametrize("setting", ["much", "0", "-1", "nan", "inf"])
def test_other_settings_are_refused(monkeypatch, setting):
    monkeypatch.setenv("VOXJAX_MEMORY", setting)
    with pytest.raises(InputError, match="gigabytes"):
        memory_limit()


class _Device:
    platform = "gpu"

    def __init__(self, stats):
        self._stats = stats

    def memory_stats(self):
        return self._stats


@pytest.mark.parametrize(
    ("stats", "left"), [({"bytes_limit": 90, "bytes_in_use": 20}, 70), ({}, None), (None, None)]
)
def test_an_accelerator_bounds_where_it_says_so(monkeypatch, stats, left):
    monkeypatch.setattr(jax, "local_devices", lambda: [_Device(stats)])
    monkeypatch.setattr(_memory, "available_memory", lambda: 80)
    monkeypatch.delenv("VOXJAX_MEMORY", raising=False)
    assert device_memory() == left
    assert memory_limit() == (80 if left is None else 70)
