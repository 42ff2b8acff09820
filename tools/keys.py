"""Write docs/keys.md: every number of a scenario file, with default, unit and range, as the code has them.

python tools/keys.py            writes the page
python tools/keys.py --check    exit status 1 if it is not up to date
"""

import sys
from pathlib import Path

from sidestep.validation.scenarios.keys import numeric_keys

PAGE = Path(__file__).parents[1] / "docs" / "keys.md"
HEAD = """# Numbers of a scenario file

Every key of a scenario file and of `--set` that holds a number, written by `python tools/keys.py` from the fields of
the code. A value outside of its range, or that is no number, ends the command in one line with key, value and range and
exit status 2. The ranges are generous: they keep out what cannot be a car, a road or a control period, not what is
unusual. `[]` stands for every entry of a list, in `--set` a number from 0: `--set obstacles.0.s=30`. Without a default
the key is required, or its value comes from elsewhere (of a car from its preset).

| Key | Default | Unit | Range |
|---|---|---|---|
"""


def page() -> str:
    """The page's text."""
    rows = (
        f"| `{key.path}` | {'' if key.default is None else f'{key.default:.6g}'} | {key.range.unit} "
        f"| {key.range.low:g} to {key.range.high:g} |\n"
        for key in numeric_keys()
    )
    return HEAD + "".join(rows)


def main() -> int:
    """Write or check the page."""
    if "--check" in sys.argv[1:]:
        return int(PAGE.read_text(encoding="utf-8") != page())
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
