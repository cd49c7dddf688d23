"""Processes that keep compiled kernels in a folder, and count what they compile."""

import os
import subprocess
import sys

COUNTED = """
import jax, numpy as np
events = []
jax.monitoring.register_event_listener(lambda name, **_: events.append(name.rsplit("/", 1)[1]))
"""


KERNEL = """
print(float(jax.jit(lambda x: (x * 3).sum())(np.ones(5, np.float32))))
print(events.count("cache_hits"), events.count("cache_misses"))
"""


COMMAND = f"""
{COUNTED}
from voxjax.cli.runtime import kept_kernels
def run():
    {KERNEL.strip().replace(chr(10), chr(10) + "    ")}
kept_kernels()(run)()
"""


def run_process(code, folder, **variables):
    """A process of its own, as a user has it: its output lines and what it said on stderr."""
    environment = {
        **{name: os.environ[name] for name in ("PYTHONPATH",) if name in os.environ},
        "PATH": os.environ["PATH"],
        "XDG_CACHE_HOME": str(folder),
        "JAX_PLATFORMS": "cpu",
        **variables,
    }
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.splitlines(), done.stderr


def kernel_entries(folder):
    return sorted((folder / "voxjax" / "xla").glob("*-cache"))
