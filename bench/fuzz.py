"""Damaged map files against the readers: each is read as a map, or refused in one sentence.

    python -m bench fuzz [--seconds S] [--reader NAME ...] [--seed N]

Each reader gets edited copies of small files, stores with edited files in them, for the given time (600 s), in a
process of its own that may take 1 GB and 10 s for a file. An exception other than `InputError`, a warning, a sentence
of several lines, a process that dies, or takes more memory or time is a failure: the file is kept in the output folder,
a store as an archive, and the exit code is 1.

Takes about 10 minutes for each of five readers, on two cores.
"""

import argparse
import hashlib
import multiprocessing
import resource
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from bench.fuzz_cases import READERS, damaged, draw, put
from bench.memory import peak_megabytes
from voxjax import InputError
from voxjax.cli.info import described_facts
from voxjax.io import describe_map, load_map

FINE = ("read", "refused")
"""Outcomes that are no failure."""

OUT = Path(__file__).parent / "out" / "fuzz"


class Limits(NamedTuple):
    """What reading one file may take.

    Attributes:
        megabytes: Memory of the process, the interpreter and the packages included [MB].
        seconds: Time of the processor [s].
        patience: Time on the clock until the process is stopped [s]; on a busy machine it is far longer.
    """

    megabytes: float = 1000.0
    seconds: float = 10.0
    patience: float = 60.0


def read_case(path: Path) -> str:
    """Describe a file as `voxjax info` does, and read it; "read", "refused", or else what went wrong."""
    # The voxel size of a cloud is given as often as it is estimated.
    voxel_size = 0.1 if path.suffix == ".ply" and path.stat().st_size % 2 else None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            described_facts(describe_map(path, voxel_size=voxel_size))
            load_map(path, voxel_size=voxel_size)
    except InputError as error:
        if isinstance(error.__cause__, MemoryError):
            return f"took too much memory: {error}"
        is_sentence = "\n" not in str(error) and str(error).endswith(".") and len(str(error)) < 1000
        return "refused" if is_sentence else f"no sentence: {str(error)[:300]!r}"
    except Exception:
        return traceback.format_exc()
    return "read"


class Answer(NamedTuple):
    """What came of a file.

    Attributes:
        outcome: "read", "refused", or what went wrong.
        megabytes: Largest memory that the process has taken so far [MB].
        seconds: Time of the processor [s].
    """

    outcome: str
    megabytes: float
    seconds: float


def serve(connection: Connection, ending: str, megabytes: float) -> None:
    """Read the files that come through a connection, and answer with what came of each."""
    # Files in memory, where the system has a folder there, so that the disk does not set the pace.
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        path = Path(folder) / f"map.{ending}"
        _limit_memory(megabytes)
        connection.send("ready")
        while (data := connection.recv()) is not None:
            put(path, data)
            start = time.process_time()
            outcome = read_case(path)
            connection.send((outcome, peak_megabytes(), time.process_time() - start))


def _limit_memory(megabytes: float) -> None:
    """Let allocations fail that would bring this process beyond its limit."""
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    status = {words[0].removesuffix(":"): words[1] for words in lines if len(words) > 1}
    reserved, resident = int(status["VmData"]) * 1024, int(status["VmRSS"]) * 1024
    # The limit counts what is reserved, and the interpreter and its packages have reserved more than they use.
    most = reserved + int(megabytes * 1e6) - resident
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


class Server:
    """A process that reads files, started again whenever it has died or was stopped."""

    def __init__(self, ending: str, limits: Limits):
        self._ending, self._limits = ending, limits
        self._start()

    def _start(self) -> None:
        # A fork would share what this process has loaded, and its memory would count as the reader's.
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process: Any = context.Process(
            target=serve, args=(theirs, self._ending, self._limits.megabytes), daemon=True
        )
        self._process.start()
        theirs.close()
        self._connection.recv()

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.join()
        self._connection.close()

    def read(self, data: bytes) -> Answer:
        """What comes of a file."""
        answer = self._ask(data)
        if answer.megabytes > self._limits.megabytes:
            answer = answer._replace(outcome=f"took {answer.megabytes:.0f} MB; {answer.outcome}")
        if answer.seconds > self._limits.seconds:
            answer = answer._replace(outcome=f"took {answer.seconds:.0f} s; {answer.outcome}")
        if answer.outcome not in FINE:
            self.stop()  # what is left of it must not weigh on the next file
            self._start()
        return answer

    def _ask(self, data: bytes) -> Answer:
        limit = self._limits.patience
        try:
            self._connection.send(data)
            if self._connection.poll(limit):
                return Answer(*self._connection.recv())
            return Answer(f"no answer in {limit:g} s", 0.0, 0.0)
        except (EOFError, OSError):
            self._process.join()
            return Answer(f"the process died with exit code {self._process.exitcode}", 0.0, 0.0)


class Result(NamedTuple):
    """What came of the files of one reader.

    Attributes:
        counts: How many were "read" and "refused", and how often each failure was seen.
        seconds: Longest time of the processor for one file [s].
        megabytes: Largest memory of a process [MB].
    """

    counts: Counter[str]
    seconds: float
    megabytes: float

    @property
    def failures(self) -> dict[str, int]:
        """How often each failure was seen."""
        return {outcome: count for outcome, count in self.counts.items() if outcome not in FINE}


def fuzz(
    reader: str,
    *,
    seconds: float,
    seed: int,
    out: Path,
    limits: Limits,
    clock: Callable[[], float] = time.monotonic,
) -> Result:
    """Give damaged files to a reader for some time; the files of failures are kept."""
    rng, counts, slowest, largest = np.random.default_rng(seed), Counter[str](), 0.0, 0.0
    server = Server(reader, limits)
    try:
        end = clock() + seconds
        while clock() < end:
            data = damaged(reader, int(rng.integers(2**32)), draw(rng))
            answer = server.read(data)
            counts[answer.outcome] += 1
            if answer.outcome not in FINE and counts[answer.outcome] == 1:
                keep(out, reader, data, answer.outcome)
            slowest, largest = max(slowest, answer.seconds), max(largest, answer.megabytes)
    finally:
        server.stop()
    return Result(counts, slowest, largest)


def keep(out: Path, reader: str, data: bytes, outcome: str) -> None:
    """Write a file that failed, and what came of it."""
    out.mkdir(parents=True, exist_ok=True)
    name = hashlib.sha256(data).hexdigest()[:12]
    (out / f"{name}.{reader}").write_bytes(data)
    (out / f"{name}.txt").write_text(outcome)
    print(f"  {out / name}.{reader}: {outcome.strip().splitlines()[-1]}", flush=True)


def main(argv: Sequence[str]) -> int:
    """Run all readers, print one line for each, and return 1 if there was a failure."""
    parser = argparse.ArgumentParser(
        prog="python -m bench fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=600.0, help="time for each reader")
    parser.add_argument("--reader", action="append", choices=READERS, help="again for several (default: all)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=OUT, help="folder for files that fail")
    args = parser.parse_args(argv)
    is_right = True
    for reader in args.reader or READERS:
        result = fuzz(reader, seconds=args.seconds, seed=args.seed, out=args.out, limits=Limits())
        failures = sum(result.failures.values())
        is_right = is_right and not failures
        print(
            f"{reader:<5}{result.counts.total():>9,} files: {result.counts['read']:,} read, "
            f"{result.counts['refused']:,} refused, {failures:,} failures of {len(result.failures)} kinds; "
            f"slowest {result.seconds:.2f} s, most {result.megabytes:.0f} MB",
            flush=True,
        )
    return 0 if is_right else 1
