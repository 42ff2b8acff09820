"""Where what is written stands until it is whole."""

import os
import secrets
from pathlib import Path


def beside(file: Path) -> Path:
    """A new, empty file of a name that nobody can foresee, of the same ending and in the same folder.

    What is written goes there and is renamed then: nobody sees half of it, and no link that waits under the name
    leads it elsewhere.

    Raises:
        OSError: The folder takes no files.
    """
    part = file.with_name(f".part-{secrets.token_hex(8)}-{file.name}")
    os.close(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    return part
