"""The `platoon` command; until it listens to Ctrl-C, that ends it without a word."""

import signal
import sys


def main() -> int:
    """Load the command and run it."""
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from cacc_platoon import cli  # noqa: PLC0415  (heavy)

    signal.signal(signal.SIGINT, before)
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
