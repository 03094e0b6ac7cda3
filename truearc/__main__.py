"""`python -m truearc`: the command line."""

import sys

from truearc.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
