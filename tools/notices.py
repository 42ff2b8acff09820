"""The page NOTICE.md: what licence each dependency is under, as its own metadata say.

python tools/notices.py            write it
python tools/notices.py --check    exit status 1 if a pinned package is missing in it, or an installed one says
something else
"""

import argparse
import re
import sys
import tomllib
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "NOTICE.md"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_HEAD = """# Notices

sidestep is under the MIT licence (LICENSE). It is installed beside packages of others, none of which it contains; each
is under its own licence. Made by `python tools/notices.py` from the metadata of the packages that constraints.txt pins;
"runs" stands for those that sidestep cannot run without, the others come with its extras, its tests or its tools.

python-can and asammdf (of the extra mdf) are under the LGPL 3: they are imported as they are, and may be replaced by
other versions of them.

| package | licence | |
|---|---|---|
"""
_LONGEST = 60  # letters of a licence's name


def pinned() -> list[str]:
    """Names of the packages in constraints.txt."""
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return sorted({_plain(found[0]) for line in lines if (found := _NAME.match(line))})


def licence(name: str) -> str | None:
    """What a package says of itself; None if it is not installed."""
    try:
        told = metadata(name)
    except PackageNotFoundError:
        return None
    classes = [line.rpartition(" :: ")[2] for line in told.get_all("Classifier", []) if line.startswith("License ::")]
    text = (told.get("License") or "").strip()
    word = text.partition("\n")[0]  # some put the whole text there
    word = word if len(word) <= _LONGEST and word.upper() != "UNKNOWN" else ""
    found = told.get("License-Expression") or ", ".join(name for name in classes if name != "OSI Approved") or word
    return " ".join((found or "not told in its metadata: see its files").replace("|", "/").split())


def running() -> set[str]:
    """What sidestep needs, and what that needs in turn, without extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found, new = set(), {_plain(_name(text)) for text in project["dependencies"]}
    while new:
        found |= new
        below = {_plain(_name(text)) for name in new for text in _requires(name) if "extra ==" not in text}
        new = below - found
    return found


def rows() -> dict[str, str]:
    """Lines of the page by package; those that are not installed keep the line that they have."""
    before = {found[1]: line for line in _lines() if (found := re.match(r"\| (\S+) \|", line))}
    needed, result = running(), {}
    for name in pinned():
        told = licence(name)
        if told is None:
            result[name] = before.get(name, f"| {name} | not installed where this page was made | |")
        else:
            result[name] = f"| {name} | {told} | {'runs' if name in needed else ''} |".replace("|  |", "| |")
    return result


def _lines() -> list[str]:
    return PAGE.read_text(encoding="utf-8").splitlines() if PAGE.exists() else []


def _requires(name: str) -> list[str]:
    try:
        return requires(name) or []
    except PackageNotFoundError:
        return []


def _name(requirement: str) -> str:
    found = _NAME.match(requirement)
    return found[0] if found else requirement


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def main() -> int:
    """Write or check the page."""
    parser = argparse.ArgumentParser(description="licences of the dependencies, in NOTICE.md")
    parser.add_argument("--check", action="store_true", help="write nothing, say whether it is as it should be")
    page = _HEAD + "\n".join(rows().values()) + "\n"
    if not parser.parse_args().check:
        PAGE.write_text(page, encoding="utf-8")
        return 0
    same = "\n".join(_lines()) + "\n" == page
    if not same:
        print("NOTICE.md is not what tools/notices.py makes of the installed packages")
    return int(not same)


if __name__ == "__main__":
    sys.exit(main())
