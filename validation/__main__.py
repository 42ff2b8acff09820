"""`python -m sidestep.validation`: the command line without its entry point."""

import sys

from sidestep.validation.cli.main import main

sys.exit(main())
