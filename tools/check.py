"""The fast checks, as a hook or by hand before a commit; CI runs the same ones over everything.

    python tools/check.py            what changed since the branch left main: below a minute
    python tools/check.py --all      everything but the tests
    python tools/check.py --base X   what changed since X

Exit status 1 if one fails; all run.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
SLOW = "not closed_loop and not vcan and not browser and not render"
PYTHON = (sys.executable, "-m")


def changed(base: str) -> list[str]:
    """Files that differ from where the branch left `base`, not committed ones included, deleted ones left out."""
    left = _git("merge-base", base, "HEAD").strip()
    names = _git("diff", "--name-only", "--diff-filter=d", left) + _git("ls-files", "--others", "--exclude-standard")
    return sorted(set(names.split()))


def tests_of(files: Iterable[str]) -> list[str]:
    """The tests of changed files: themselves, and those of the room's folder that are named after a module."""
    found = set()
    for file in map(Path, files):
        if file.suffix != ".py":
            continue
        if file.parts[0] == "tests":
            found |= {str(file)} if file.name.startswith("test_") else set()
            continue
        room = ROOT / "tests" / file.parent
        found |= {str(test.relative_to(ROOT)) for test in room.glob(f"test_*{file.stem}*.py")}
    return sorted(found)


def _git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout


def _passes(name: str, command: Sequence[str]) -> bool:
    began = time.perf_counter()
    passed = subprocess.run(command, cwd=ROOT, check=False).returncode in (0, 5)  # 5: no test left by -m
    print(f"--- {name}: {'ok' if passed else 'FAILED'}, {time.perf_counter() - began:.0f} s", flush=True)
    return passed


def checks(files: Sequence[str] | None) -> list[tuple[str, list[str]]]:
    """Names and commands; `files` None for everything."""
    python = None if files is None else [file for file in files if file.endswith((".py", ".pyi"))]
    typed = [] if python is None else [file for file in python if file.split("/")[0] not in ("tests", "tools", ".ci")]
    some = [] if python is None else python
    found: list[tuple[str, list[str]]] = []
    if python is None or python:
        found += [
            ("ruff check", [*PYTHON, "ruff", "check", *some]),
            ("ruff format", [*PYTHON, "ruff", "format", "--check", *some]),
        ]
    if python is None or typed:
        found.append(("pyright", [*PYTHON, "pyright", "--pythonpath", sys.executable, *typed]))
    found.append(("pages made from the code", [sys.executable, "tools/pages.py", "--check"]))
    found.append(("page of licences", [sys.executable, "tools/notices.py", "--check"]))
    found.append(("bounds of the code", [sys.executable, "tools/count.py"]))
    if files and (tests := tests_of(files)):
        found.append(("tests of what changed", [*PYTHON, "pytest", "-q", "-x", "-m", SLOW, *tests]))
    return found


def main() -> int:
    """Run them."""
    parser = argparse.ArgumentParser(description="ruff, pyright, bounds of the code, and the tests of what changed")
    parser.add_argument("--all", action="store_true", help="all files, and no tests")
    parser.add_argument("--base", default="main", help="branch or commit to compare with; default: %(default)s")
    options = parser.parse_args()
    results = [_passes(*check) for check in checks(None if options.all else changed(options.base))]
    return int(not all(results))


if __name__ == "__main__":
    sys.exit(main())
