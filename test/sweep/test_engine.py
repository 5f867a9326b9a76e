"""Rows on processes: those that kill them are failed rows, all others are there."""

import importlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.sweep.engine import Evaluation, Processes, evaluate_point
from cacc_platoon.sweep.plan import parse_plan

OWN = """
import os, signal, time
from pathlib import Path

MARKS = Path(__file__).parent

def dies(scenario, row):
    '''Kill the own process at row 3 always, at row 7 the first time.'''
    if row == 3 or row == 7 and not (MARKS / "once").exists():
        (MARKS / "once").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return {"seed": scenario.run.seed, "pid": os.getpid()}
"""
PLAN = parse_plan(
    {"seeds": {"from": 10, "count": 12}, "columns": ["seed"], "criteria": ["seed > 11"]},
    "mine",
    Path(),
)


@pytest.mark.slow
def test_a_row_that_kills_its_process_is_a_failed_one_and_no_other(tmp_path, monkeypatch):
    (tmp_path / "own_evaluate.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    own_evaluate = importlib.import_module("own_evaluate")
    evaluation = Evaluation(
        PLAN, PLAN.points(), lambda: Processes(2), workers=2, evaluate=own_evaluate.dies
    )
    rows = sorted(evaluation.rows())
    assert [one.row for one in rows] == [*range(12)]
    assert [one.row for one in rows if one.failed] == [3]
    assert "ended every time" in rows[3].failed
    assert [one.values["seed"] for one in rows if not one.failed] == [
        *(10, 11, 12),
        *range(14, 22),
    ]
    assert [one.met["seed > 11"] for one in rows if not one.failed][:3] == [False, False, True]


def test_what_makes_a_row_fail_is_its_result():
    def refuse(_scenario, row):
        raise {0: UserError("no such thing"), 1: ZeroDivisionError("by 0")}[row]

    for row, words in ((0, "no such thing"), (1, "ZeroDivisionError: by 0")):
        point = [*PLAN.points()][row]
        found = evaluate_point(PLAN.scenario, point, PLAN.columns, PLAN.criteria, refuse)
        assert (found.row, found.failed, found.passed) == (row, words, False)


def test_any_executor_gives_the_same_rows():
    def seed(scenario, _row):
        return {"seed": scenario.run.seed}

    evaluation = Evaluation(
        PLAN, PLAN.points(), lambda: ThreadPoolExecutor(3), workers=3, evaluate=seed
    )
    expected = [
        evaluate_point(PLAN.scenario, point, PLAN.columns, PLAN.criteria, seed)
        for point in PLAN.points()
    ]
    assert sorted(evaluation.rows()) == expected
