"""The command line, run as `python -m truearc`."""

import sys

from truearc.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
