"""Work shared by several processes: each is a fresh interpreter, is told what to call, and answers with what failed.

They are neither forked, for JAX has threads, nor made by `multiprocessing`, which would run the caller's script again
in each of them. A process whose parent has gone ends by itself.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import IO, Any

from .._checks import InputError

_BEGIN = (
    "import pickle, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "sys.path[:] = pickle.load(sys.stdin.buffer); from voxjax._runtime.processes import serve; "
    "serve(int(sys.argv[1]))"
)


def run_in_processes(function: Callable[..., None], shares: Sequence[tuple]) -> None:
    """Call a function once for each share of some work, each in a process of its own, all at once.

    Args:
        function: One of a module, so that the processes find it; what it returns is not looked at.
        shares: The arguments of each call; each process is given a copy.

    Raises:
        InputError: If a call raised that, or a process was ended from outside, as the system does where memory does
            not suffice. All others have ended then.
        OSError: If a call raised that.
        MemoryError: Likewise.
        RuntimeError: If a call raised anything else, or a process died.
    """
    settings = _settings_of_jax()
    # Several processes cannot each have most of the memory of one accelerator.
    environment = {"XLA_PYTHON_CLIENT_PREALLOCATE": "false", **os.environ}
    with contextlib.ExitStack() as started:
        # Ended last: its threads wait for the processes, which are stopped first.
        pool = started.enter_context(ThreadPoolExecutor(len(shares)))
        processes = []
        for _ in shares:
            # The answer has a channel of its own: what the process prints is none, not even while it starts.
            answer, end = os.pipe()
            channel = started.enter_context(os.fdopen(answer, "rb"))
            try:
                process = subprocess.Popen(
                    # Without -P the folder that this process runs in would be searched for modules.
                    [sys.executable, "-P", "-c", _BEGIN, str(end)],
                    stdin=subprocess.PIPE,
                    stdout=2,
                    env=environment,
                    pass_fds=(end,),
                )
            finally:
                os.close(end)
            started.callback(_stop, process)
            processes.append((process, channel))
        answers = [
            pool.submit(_converse, process, channel, (function, share, settings))
            for (process, channel), share in zip(processes, shares, strict=True)
        ]
        for answer in as_completed(answers):
            answer.result()


def serve(channel: int) -> None:
    """Do what the parent process asks for through the standard input, and answer through a file descriptor."""
    with os.fdopen(channel, "wb") as answer:
        function, share, settings = pickle.load(sys.stdin.buffer)
        threading.Thread(target=_end_with_parent, daemon=True).start()
        pickle.dump(_failure_of(function, share, settings), answer)


def _failure_of(function: Callable[..., None], share: tuple, settings: dict[str, Any]) -> Exception | None:
    """What a call raised, as something that goes through `pickle`; None if all went well."""
    import jax

    try:
        for name, value in settings.items():
            jax.config.update(name, value)
        function(*share)
    except InputError as error:
        return InputError(str(error))
    except OSError as error:
        return OSError(*error.args)
    except Exception as error:
        text = str(error)
        is_memory = isinstance(error, MemoryError) or text.startswith("RESOURCE_EXHAUSTED")
        return MemoryError(text) if is_memory else RuntimeError(f"{type(error).__name__}: {text}")
    return None


def _converse(process: subprocess.Popen, channel: IO[bytes], job: tuple) -> None:
    """Give a process its work, wait for its end, and raise what failed."""
    assert process.stdin is not None
    # Of a process that has died, what follows says why.
    with contextlib.suppress(BrokenPipeError):
        pickle.dump(sys.path, process.stdin)
        pickle.dump(job, process.stdin)
        process.stdin.flush()
    answer = channel.read()
    code = process.wait()
    if code == -signal.SIGKILL:
        raise InputError(
            "one of the processes was killed, as the system does where the memory does not suffice; "
            "use fewer processes, or find more memory."
        )
    if code < 0:
        raise InputError(
            f"one of the processes was ended from outside by {signal.Signals(-code).name}; run it again."
        )
    if code or not answer:
        raise RuntimeError(f"one of the processes ended with exit code {code}")
    failure = pickle.loads(answer)
    if failure is not None:
        raise failure


def _stop(process: subprocess.Popen) -> None:
    """End a process that has not ended, and close what leads to it."""
    process.kill()
    process.wait()
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()


def _settings_of_jax() -> dict[str, Any]:
    """Where kernels run and are kept, which a fresh interpreter knows only as far as its environment says so."""
    import jax

    names = ("jax_platforms", "jax_compilation_cache_dir")
    names += tuple(
        f"jax_persistent_cache_{name}" for name in ("min_compile_time_secs", "min_entry_size_bytes")
    )
    return {name: getattr(jax.config, name) for name in names}


def _end_with_parent() -> None:
    """End this process when the parent has closed its end of the standard input, as it does by dying."""
    while os.read(0, 1):
        pass
    os._exit(1)
