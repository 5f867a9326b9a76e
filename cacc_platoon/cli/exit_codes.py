"""Exit codes of the `platoon` command."""

DONE, FAILED, BAD_INPUT, NOT_STRING_STABLE = 0, 1, 2, 3
INTERRUPTED = 130
