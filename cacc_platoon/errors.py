"""The root of every error that a user can put right, and what a line may hold that is shown."""

MAX_LINE = 2000
"""Characters of a line that is shown to somebody."""


class UserError(Exception):
    """Bad input: one line that names the value, the rule, the consequence and the remedy."""

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


def one_line(text: str, most: int = MAX_LINE) -> str:
    r"""Return a text as one line that can be shown anywhere, whatever file it came from.

    Parameters
    ----------
    text : str
        May hold line breaks, control characters and any number of letters.
    most : int, optional
        Characters to keep; the middle of a longer text is left out.

    Examples
    --------
    >>> one_line("no such\n  table\x00")
    'no such table\\x00'
    """
    if len(text) > 4 * most:
        text = text[: 2 * most] + text[-2 * most :]
    line = printable(" ".join(part.strip() for part in text.splitlines()))
    return line if len(line) <= most else f"{line[: most * 2 // 3]} ... {line[-most // 3 :]}"


def printable(text: str) -> str:
    r"""Return a text with everything escaped that is no letter and no end of a line.

    Examples
    --------
    >>> printable("a title\x1b]0;changed\x07\n")
    'a title\\x1b]0;changed\\x07\n'
    """
    return "\n".join(
        line if line.isprintable() else "".join(_shown(letter) for letter in line)
        for line in text.split("\n")
    )


def _shown(letter: str) -> str:
    return letter if letter.isprintable() else letter.encode("unicode_escape").decode()
