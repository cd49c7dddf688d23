"""Processes of their own with several host devices each, for the tests of what is shared out over devices."""

import os
import socket
import subprocess
import sys

import pytest

LIMIT_S = 120


def start(worker, arguments, *, devices):
    """A script in a process of its own, with so many host devices."""
    environment = os.environ | {"JAX_NUM_CPU_DEVICES": str(devices), "JAX_PLATFORMS": "cpu"}
    return subprocess.Popen(
        [sys.executable, str(worker), *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def start_joined(worker, arguments, *, processes, devices):
    """The script in several processes that are to be joined: `process PORT COUNT RANK` follow its arguments."""
    try:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
    except OSError as error:
        pytest.skip(f"this machine grants no port on the loopback address: {error}")
    return [
        start(worker, [*arguments, "process", port, processes, rank], devices=devices)
        for rank in range(processes)
    ]


def lines_of(processes):
    """What each process printed that begins with "equal on", after it has ended well."""
    try:
        ended = [process.communicate(timeout=LIMIT_S) for process in processes]
    finally:
        for process in processes:
            process.kill()
    for process, (_, errors) in zip(processes, ended, strict=True):
        assert process.returncode == 0, errors[-3000:]
    # Gloo prints lines of its own.
    return [[line for line in out.splitlines() if line.startswith("equal on")] for out, _ in ended]
