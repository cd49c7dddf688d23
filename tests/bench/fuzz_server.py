"""Stands for a process that reads files, and imports nothing that takes long."""

import time


def serve(connection, ending, megabytes):
    """Do what the files say."""
    connection.send("ready")
    while (data := connection.recv()) is not None:
        if data == b"hangs":
            time.sleep(60)
        if data == b"dies":
            raise SystemExit(7)
        connection.send(("read", 2000.0 if data == b"large" else 100.0, 12.0 if data == b"slow" else 0.1))
