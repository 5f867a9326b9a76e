"""Rows on disk: what is whole is kept, to the last bit, and what was cut is computed again."""

import math
import random

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.sweep.rows import RowResult, RowsFile


def result(row, value=0.1):
    return RowResult(row, {"min_gap": value, "headline": "Ü"}, {"min_gap > 0": True})


def test_rows_come_back_to_the_last_bit(tmp_path):
    values = [math.pi * 10.0**k for k in range(-300, 300, 7)]
    with RowsFile(tmp_path / "rows") as file:
        for row, value in enumerate(values):
            file.add(result(row, value))
    with RowsFile(tmp_path / "rows") as file:
        assert [one.values["min_gap"] for one in file.rows.values()] == values
        assert file.rows[3] == result(3, values[3])


def test_wherever_it_was_cut_whole_rows_are_kept_and_it_goes_on(tmp_path):
    with RowsFile(tmp_path / "rows") as file:
        for row in range(5):
            file.add(result(row))
    whole = (tmp_path / "rows").read_bytes()
    ends = [k + 1 for k, byte in enumerate(whole) if byte == 10]
    for cut in random.Random(1).sample(range(len(whole)), 40):
        (tmp_path / "rows").write_bytes(whole[:cut])
        with RowsFile(tmp_path / "rows") as file:
            kept = sum(end <= cut for end in ends)
            assert [*file.rows] == [*range(kept)]
            for row in range(kept, 5):
                file.add(result(row))
        assert (tmp_path / "rows").read_bytes() == whole


def test_two_processes_do_not_write_to_one_study(tmp_path):
    with RowsFile(tmp_path / "rows"), pytest.raises(UserError, match="another process"):
        RowsFile(tmp_path / "rows")
    with RowsFile(tmp_path / "rows") as file:
        file.add(result(0, math.inf))
    with RowsFile(tmp_path / "rows") as file:
        assert file.rows[0].values["min_gap"] == math.inf


@pytest.mark.parametrize("line", ["nothing", "{}", "[1]", '{"row": 1}', "\x00"])
def test_a_damaged_line_is_named(tmp_path, line):
    (tmp_path / "rows").write_text(f"{result(0).to_json()}\n{line}\n")
    with pytest.raises(UserError, match="line 2 is no row of a study"):
        RowsFile(tmp_path / "rows")
