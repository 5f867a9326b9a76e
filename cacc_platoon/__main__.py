"""`python -m cacc_platoon` is the `platoon` command."""

import sys

from cacc_platoon.cli import main

if __name__ == "__main__":
    sys.exit(main())
