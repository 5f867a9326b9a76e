"""Lines drawn in place: what a terminal shows after each step, by a terminal of the test's own."""

import io
import os
import re

from cacc_platoon.live.screen import USUAL, Above, Screen, coloured, is_screen


class Terminal(io.StringIO):
    """A terminal of 24 lines that understands what is used here, and nothing else."""

    encoding = "ascii"

    def isatty(self) -> bool:
        return True

    def shown(self) -> list[str]:
        rows: list[str] = [""]
        row = 0
        for piece in re.findall(r"\x1b\[\d*[A-Za-z]|\n|\r|[^\x1b\n\r]+", self.getvalue()):
            if piece == "\n":
                row += 1
                rows += [""] * (row + 1 - len(rows))
            elif piece == "\x1b[2K":
                rows[row] = ""
            elif piece == "\x1b[J":
                del rows[row + 1 :]
                rows[row] = ""
            elif piece.endswith("A"):
                row -= int(piece[2:-1])
            elif piece != "\r":
                assert not piece.startswith("\x1b"), piece
                rows[row] += piece
        return rows


def test_a_picture_takes_the_place_of_the_one_before():
    terminal = Terminal()
    screen = Screen(terminal)
    for lines in (["one", "two", "three"], ["four"], ["five", "six"]):
        screen.draw(lines)
        assert terminal.shown() == [*lines, ""]
    screen.clear()
    assert terminal.shown() == [""]


def test_what_others_say_stays_above():
    terminal = Terminal()
    screen = Screen(terminal)
    above = Above(screen.clear, terminal)
    screen.draw(["one", "two"])
    print("a warning", file=above)
    screen.draw(["three"])
    assert terminal.shown() == ["a warning", "three", ""]


def test_what_the_terminal_cannot_show_is_escaped():
    terminal = Terminal()
    Screen(terminal).draw(["größer"])
    assert terminal.shown()[0] == "gr\\xf6\\xdfer"


def test_no_sequence_outlasts_the_process():
    """Neither the cursor is hidden nor another screen chosen: kill -9 leaves nothing to mend."""
    terminal = Terminal()
    Screen(terminal).draw(["one"])
    assert "?" not in terminal.getvalue()


def test_the_size_is_a_usual_one_where_nothing_says_it():
    assert Screen(Terminal()).size == USUAL
    reader, writer = os.pipe()
    with os.fdopen(reader), os.fdopen(writer, "w") as pipe:
        assert Screen(pipe).size == USUAL


def test_colours_and_drawing_are_as_the_environment_says():
    assert coloured({})
    assert not coloured({"NO_COLOR": "1"})
    assert not coloured({"TERM": "dumb"})
    assert is_screen(Terminal(), {})
    assert not is_screen(Terminal(), {"TERM": "dumb"})
    assert not is_screen(io.StringIO(), {})
