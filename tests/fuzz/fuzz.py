"""Damaged files for every reader: `python tests/fuzz/fuzz.py FORMAT COUNT SEED [--keep DIR]`; FORMAT may be `all`.

Every case must end within SECONDS and MEGABYTES, in a value, an InputError or a PlantError; case N of a seed is the
same file wherever it is made. Prints a line a format, and for every kind of failure the first case that has it. Exit
status 1 if there is any. A case that does not come back at all ends the process with its traceback; --keep has its
file.
"""

import argparse
import faulthandler
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent)]

from formats import FORMATS, Format  # noqa: E402

from sidestep.plant_models.errors import InputError, PlantError  # noqa: E402

SECONDS, MEGABYTES = 20.0, 1500
"""Of one case, processor time and memory: far more than any honest file of these sizes takes."""


class TooSlowError(BaseException):
    """A case that takes longer than SECONDS; nothing that is tested may catch it."""


@dataclass
class Tally:
    """What became of the cases.

    Attributes:
        read: Files that were read.
        refused: Files that were refused.
        failures: By kind: exception and place; the first case and what was said.
        counts: How often each kind came.
        slowest: Seconds of the slowest case, and its number.
    """

    read: int = 0
    refused: int = 0
    failures: dict[str, tuple[int, str]] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    slowest: tuple[float, int] = (0.0, 0)


def case(kind: Format, number: int, seed: int) -> bytes:
    """The file of a case."""
    return kind.make(random.Random(f"{kind.name} {seed} {number}"))


def fuzz(kind: Format, count: int, seed: int, folder: Path, first: int = 0) -> Tally:
    """Run cases `first` to `first + count` of a format in a folder of their own."""
    tally, file = Tally(), kind.prepare(folder)
    for number in range(first, first + count):
        data = case(kind, number, seed)
        file.write_bytes(data)
        began = time.process_time()
        try:
            with _bounded():
                kind.read(file)
            tally.read += 1
        except (InputError, PlantError) as error:
            tally.refused += 1
            if any(letter < " " and letter not in "\n\t" for letter in str(error)):
                _note(tally, number, error, "what a terminal obeys")
        except (Exception, TooSlowError) as error:
            _note(tally, number, error)
        took = time.process_time() - began
        tally.slowest = max(tally.slowest, (took, number))
    return tally


def _note(tally: Tally, number: int, error: BaseException, what: str = "") -> None:
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "site-packages" not in frame.filename] or frames
    at = ours[-1]
    kind = f"{what or type(error).__name__} at {Path(at.filename).name}:{at.lineno}"
    tally.counts[kind] += 1
    tally.failures.setdefault(kind, (number, f"{type(error).__name__}: {error}"[:200]))


@contextmanager
def _bounded() -> Iterator[None]:
    """An alarm after SECONDS, the end of the process where even that does not get through, and so much memory."""

    def alarm(*_: object) -> None:
        raise TooSlowError(f"longer than {SECONDS} s")

    before, limits = signal.signal(signal.SIGPROF, alarm), resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * os.sysconf("SC_PAGE_SIZE") + MEGABYTES * 1_000_000
    resource.setrlimit(resource.RLIMIT_AS, (most, limits[1]))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    faulthandler.dump_traceback_later(20 * SECONDS, exit=True)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGPROF, before)
        resource.setrlimit(resource.RLIMIT_AS, limits)


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("format", choices=[*FORMATS, "all"])
    parser.add_argument("count", type=int)
    parser.add_argument("seed", type=int)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--keep", type=Path, help="folder for the files; they go otherwise")
    options = parser.parse_args()
    warnings.simplefilter("error")
    failed = False
    for name in FORMATS if options.format == "all" else [options.format]:
        with tempfile.TemporaryDirectory() as folder:
            place = options.keep / name if options.keep else Path(folder)
            place.mkdir(parents=True, exist_ok=True)
            tally = fuzz(FORMATS[name], options.count, options.seed, place, options.first)
        failed |= bool(tally.failures)
        wrong = sum(tally.counts.values())
        print(
            f"{name}: {options.count} cases, seed {options.seed}: {tally.read} read, {tally.refused} refused, {wrong} "
            f"wrong, slowest {tally.slowest[0]:.2f} s (case {tally.slowest[1]})", flush=True,
        )  # fmt: skip
        for kind, (number, words) in tally.failures.items():
            print(f"  {tally.counts[kind]} x {kind}: case {number}: {words!a}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
