"""Write the pages of docs/ that are made from the code: scenario files, and our own CAN messages.

python tools/pages.py            writes them
python tools/pages.py --check    exit status 1 if one is not up to date, and names it
"""

import sys
from collections.abc import Callable
from pathlib import Path

from sidestep.controller.can_port.codec.export import page
from sidestep.validation.scenarios.schema import markdown

DOCS = Path(__file__).parents[1] / "docs"
PAGES: dict[str, Callable[[], str]] = {"scenarios.md": markdown, "can_messages.md": page}


def main() -> int:
    """Write or check the pages."""
    if "--check" in sys.argv[1:]:
        old = [name for name, text in PAGES.items() if (DOCS / name).read_text(encoding="utf-8") != text()]
        for name in old:
            print(f"docs/{name} is not what python tools/pages.py writes")
        return int(bool(old))
    for name, text in PAGES.items():
        (DOCS / name).write_text(text(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
