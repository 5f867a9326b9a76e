"""The `platoon` command; until it listens to Ctrl-C, that ends it without a word."""

import os
import signal
import sys


def main() -> int:
    """Load the command and run it.

    Its matrices are so small that threads of the linear algebra only wait for each other.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cacc_platoon import cli  # noqa: PLC0415  (heavy)

    signal.signal(signal.SIGINT, before)
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
