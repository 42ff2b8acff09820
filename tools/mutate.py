#!/usr/bin/env python3
"""Mutation testing: changes one token of a room's files at a time and looks whether the room's quick tests notice.

    tools/mutate.py list [--only PATH]                              those of tools/mutants.toml: all have to die
    tools/mutate.py ROOM [--sample 40] [--seed 0] [--minutes 10]    a sample of what can be changed in ROOM
    tools/mutate.py rooms                                           the rooms, and how many mutants each has

ROOM is a folder of tools/mutants.toml or one above some of them. Everything happens in a copy of the tree, with the
kernels as plain Python (a mutant starts at once) and a time-out. Sample and order hang on the seed alone, so that a
longer run begins with the mutants of a shorter one. Ends with exit status 1 if a listed mutant lives or a room's tests
fail without any; survivors of a sample are told, not judged: docs/mutation.md.
"""

import argparse
import ast
import io
import keyword
import multiprocessing
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tokenize
import tomllib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
SWAPPED = {
    "+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "**": "*", "&": "|", "|": "&", "+=": "-=", "-=": "+=",
    "*=": "/=", "/=": "*=", "==": "!=", "!=": "==", "and": "or", "or": "and", "True": "False", "False": "True",
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin", "is": "is not",
    "break": "continue", "continue": "break",
}  # fmt: skip
"""What stands for what; the others are in `_changes`."""
ORDER = {"<": ("<=", ">"), "<=": ("<", ">"), ">": (">=", "<"), ">=": (">", "<")}
"""A comparison has its limit moved, and is turned round."""
PRELOADED = ("numpy", "scipy.integrate", "scipy.optimize", "numba", "piqp", "pytest", "shapely",
             "msgspec", "mujoco", "fmpy", "can", "cantools")  # fmt: skip
"""What every test process would import anew."""
KILLED, SURVIVED, LATE = "killed", "survived", "timed out"


class Mutant(NamedTuple):
    """One change: `before` at an offset of the file's text becomes `after`."""

    file: str
    offset: int
    before: str
    after: str

    def applied(self, text: str) -> str:
        """The file's text with the change."""
        return text[: self.offset] + self.after + text[self.offset + len(self.before) :]

    def told(self, text: str) -> str:
        """Place and change for the table: the line before and after."""
        number, at = text.count("\n", 0, self.offset) + 1, text.rfind("\n", 0, self.offset) + 1
        line = text[at:].split("\n", 1)[0].strip()
        column = self.offset - at - (len(text[at : self.offset]) - len(text[at : self.offset].lstrip()))
        shown = line[:column] + f"[{self.before} -> {self.after}]" + line[column + len(self.before) :]
        return f"{self.file}:{number} | `{shown}`".replace("||", "&#124;&#124;")


def mutants_of(file: str, text: str) -> list[Mutant]:
    """All mutants of a file: one token changed, outside annotations, imports, decorators and strings."""
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    exempt, unary = _exempt(ast.parse(text))
    found, before = [], None
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        row, column = token.start
        if token.type in (tokenize.OP, tokenize.NAME, tokenize.NUMBER):
            if not any(start <= token.start < end for start, end in exempt):
                for after in _changes(token, before, token.start in unary):
                    found.append(Mutant(file, starts[row - 1] + column, token.string, after))
            before = token
    return [mutant for mutant in found if _compiles(mutant.applied(text))]


def _changes(token: tokenize.TokenInfo, before: tokenize.TokenInfo | None, is_unary: bool) -> list[str]:
    """What may stand instead of a token."""
    text = token.string
    if token.type == tokenize.NUMBER:
        value = ast.literal_eval(text)
        return [repr(value + 1)] if isinstance(value, int) else [repr(2.0 * value if value else 1.0)]
    if is_unary:
        return [" "]
    if text in ("+", "-", "*", "**") and (before is None or not _ends_operand(before)):
        return []  # an argument's star
    if text in ORDER:
        return list(ORDER[text])
    return [SWAPPED[text]] if text in SWAPPED else []


def _ends_operand(token: tokenize.TokenInfo) -> bool:
    return token.string in (")", "]", "}") or (token.type != tokenize.OP and not keyword.iskeyword(token.string))


def _exempt(tree: ast.Module) -> tuple[list[tuple], set[tuple]]:
    """Spans that are no behaviour, and where signs and `not` stand."""
    spans, unary = [], set()
    for node in ast.walk(tree):
        out: list = [node] if isinstance(node, ast.Import | ast.ImportFrom) else []
        out += getattr(node, "decorator_list", [])
        out += [getattr(node, name) for name in ("annotation", "returns") if getattr(node, name, None)]
        spans += [((n.lineno, n.col_offset), (n.end_lineno, n.end_col_offset)) for n in out]
        if isinstance(node, ast.UnaryOp):
            unary.add((node.lineno, node.col_offset))
    return spans, unary


def _compiles(text: str) -> bool:
    try:
        compile(text, "mutant", "exec", dont_inherit=True)
    except SyntaxError:
        return False
    return True


class Bench:
    """A copy of the tree in which mutants are tried; a context manager."""

    def __init__(self, limit: float):
        """Copy what is there now; a run of tests that takes longer than `limit` [s] is ended."""
        self.limit, self.room = limit, Path(tempfile.mkdtemp(prefix="mutants-"))
        self.tree = self.room / "sidestep"
        left_out = shutil.ignore_patterns("__pycache__", ".git", ".venv", "runs", "scratch", "*.egg-info", ".*_cache")
        shutil.copytree(ROOT, self.tree, symlinks=True, ignore=left_out)
        os.environ["NUMBA_DISABLE_JIT"] = "1"
        self._processes = multiprocessing.get_context("forkserver")
        self._processes.set_forkserver_preload(list(PRELOADED))

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *exc: object) -> None:
        shutil.rmtree(self.room)

    def tries(self, mutant: Mutant, tests: list[str]) -> str:
        """What becomes of a mutant."""
        file = self.tree / mutant.file
        text = file.read_text(encoding="utf-8")
        file.write_text(mutant.applied(text), encoding="utf-8")
        try:
            return self.runs(tests)
        finally:
            file.write_text(text, encoding="utf-8")

    def runs(self, tests: list[str]) -> str:
        """KILLED if one of the tests fails, SURVIVED if all pass, LATE if they do not end."""
        process = self._processes.Process(target=_test, args=(str(self.tree), tests))
        process.start()
        process.join(self.limit)
        if process.is_alive():
            os.killpg(process.pid or 0, signal.SIGKILL)
            process.join()
            return LATE
        return SURVIVED if process.exitcode == 0 else KILLED


def _test(tree: str, tests: list[str]) -> None:
    """Run tests in this process, a fork that goes no farther; its exit status is theirs."""
    os.setsid()
    sys.dont_write_bytecode = True  # the next mutant may have the same size and time
    os.chdir(tree)
    sys.path[:0] = [f"{tree}/.ci/types"]
    os.environ["PYTHONPATH"] = f"{tree}/.ci/types"
    with open("mutant.log", "w") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    import pytest

    options = ["-x", "-q", "-p", "no:cacheprovider", "--hypothesis-seed=0", "-m", "not closed_loop"]
    status = pytest.main([*options, *tests])
    sys.stdout.flush()
    os._exit(int(status))


def read_table() -> dict:
    """tools/mutants.toml."""
    return tomllib.loads((ROOT / "tools" / "mutants.toml").read_text(encoding="utf-8"))


def files_of(room: dict) -> list[str]:
    """A room's files, from the tree's root."""
    found = sorted(file for pattern in room["files"] for file in ROOT.glob(pattern) if file.name != "__init__.py")
    return [str(file.relative_to(ROOT)) for file in found]


def all_mutants(room: dict) -> list[Mutant]:
    """All mutants of a room's files."""
    return [m for file in files_of(room) for m in mutants_of(file, (ROOT / file).read_text(encoding="utf-8"))]


def try_room(bench: Bench, name: str, room: dict, count: int, seed: int, until: float) -> bool:
    """Try a sample and print the table; whether the tests pass without a mutant."""
    mutants = all_mutants(room)
    total = len(mutants)
    random.Random(seed).shuffle(mutants)
    began = time.monotonic()
    if (result := bench.runs(room["tests"])) != SURVIVED:
        what = f"do not end within {bench.limit:g} s" if result == LATE else "fail"
        print(f"{name}: its tests {what} without any mutant, see:\n{(bench.tree / 'mutant.log').read_text()[-3000:]}")
        return False
    print(f"## {name}: {total} mutants, seed {seed}, tests take {time.monotonic() - began:.0f} s\n", flush=True)
    print("| result | place | change |\n|---|---|---|")
    results: Counter = Counter()
    for mutant in mutants[:count]:
        if time.monotonic() > until:
            break
        result = bench.tries(mutant, room["tests"])
        results[result] += 1
        print(f"| {result} | {mutant.told((ROOT / mutant.file).read_text(encoding='utf-8'))} |", flush=True)
    told = ", ".join(f"{results[result]} {result}" for result in (KILLED, LATE, SURVIVED))
    print(f"\n{name}: {sum(results.values())} of {total} tried: {told}\n", flush=True)
    return True


def try_list(bench: Bench, table: dict, only: str) -> bool:
    """Try the listed mutants of the files so named, each with its own test; whether all die, and only they."""
    chosen, alive = [entry for entry in table["mutants"] if only in entry["file"]], 0
    for entry in chosen:
        text = (ROOT / entry["file"]).read_text(encoding="utf-8")
        if text.count(entry["before"]) != 1:
            result = f"stands {text.count(entry['before'])} times in the file instead of once"
        elif bench.runs([entry["test"]]) != SURVIVED:
            result = "the test fails without it, too"
        else:
            result = bench.tries(Mutant(entry["file"], text.index(entry["before"]), entry["before"], entry["after"]),
                                 [entry["test"]])  # fmt: skip
        alive += result != KILLED
        print(f"{result:8} {entry['name']}: {entry['file']}, {entry['test'].split('::')[-1]}", flush=True)
    print(f"{len(chosen) - alive} of {len(chosen)} listed mutants killed")
    return alive == 0 and bool(chosen)


def main() -> int:
    """Command line; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("room", help="list, rooms, or a room")
    parser.add_argument("--sample", type=int, default=40, help="mutants of each room (40)")
    parser.add_argument("--seed", type=int, default=0, help="of the sample (0)")
    parser.add_argument("--minutes", type=float, default=10.0, help="after which no mutant is begun, per room (10)")
    parser.add_argument("--limit", type=float, default=180.0, help="on one run of the tests, in s (180)")
    parser.add_argument("--only", default="", help="of the list: mutants of files that have this in their path")
    options = parser.parse_args()
    table = read_table()
    chosen = {name: room for name, room in table["rooms"].items() if f"{name}/".startswith(f"{options.room}/")}
    if options.room == "rooms":
        for name, room in table["rooms"].items():
            print(f"{name:28} {len(files_of(room)):3} files {len(all_mutants(room)):5} mutants")
        return 0
    if options.room != "list" and not chosen:
        print(f"{options.room}: no such room; allowed: list, rooms, {', '.join(table['rooms'])}", file=sys.stderr)
        return 2
    with Bench(options.limit) as bench:
        if options.room == "list":
            return not try_list(bench, table, options.only)
        done = [try_room(bench, name, room, options.sample, options.seed, time.monotonic() + 60.0 * options.minutes)
                for name, room in chosen.items()]  # fmt: skip
    return not all(done)


if __name__ == "__main__":
    sys.exit(main())
