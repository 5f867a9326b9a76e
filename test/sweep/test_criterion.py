"""Criteria of a study: small texts, no code, and clear words where they mean nothing."""

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.sweep.criterion import Criterion, Value

DOCUMENT = {
    "min_gap": 2.5,
    "max_abs_spacing_error": [3.0, 1.5],
    "hop_ratio": {"max": [1.0, None, 0.5], "l2": []},
    "collision": False,
    "min_time_to_collision": float("inf"),
    "first_collision": None,
    "verdict": {"string_stable": True, "headline": "STRING STABLE", "paper": {"basis": "x"}},
}


@pytest.mark.parametrize(
    ("text", "holds"),
    [
        ("string_stable", True),
        ("verdict.string_stable", True),
        ("not collision", True),
        ("not string_stable", False),
        ("min_gap>2", True),
        ("min_gap > 2.5", False),
        ("min_gap >= 2.5", True),
        ("min_gap == 2.5", True),
        ("min_gap != 2.5", False),
        ("not min_gap < 1e1", False),
        ("max_abs_spacing_error[-1] < 1.6", True),
        ("max_abs_spacing_error[0] <= -inf", False),
        ("max(max_abs_spacing_error) < 3", False),
        ("max(hop_ratio.l2) < 9", False),  # an empty list has no largest
        ("max(hop_ratio.max) < 9", False),  # nor one in which something is unknown
        ("min(max_abs_spacing_error) == 1.5", True),
        ("first_collision.time > 5", False),
        ("not first_collision.time > 5", False),
        ("min_time_to_collision > 2", True),
        ("first_collision", False),  # what is unknown is no answer
        ("not first_collision", False),
        ("first_collision > 0", False),
    ],
)
def test_what_holds(text, holds):
    assert Criterion.parse(text).holds(DOCUMENT) is holds


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is none"),
        ("min_gap >", "no name of a number"),
        ("min_gap > two", "two is no number"),
        ("min_gap > nan", "nothing compares with nan"),
        ("min_gap > 1 > 2", "no name of a number"),
        ("min_gap + 1 > 2", "no name of a number"),
        ("__import__('os')", "no name of a number"),
        ("median(min_gap) > 1", "no name of a number"),
        ("min_gap" * 50, "is none"),
    ],
)
def test_what_is_no_criterion(text, words):
    with pytest.raises(UserError, match=words) as told:
        Criterion.parse(text)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("mingap > 1", "there is no mingap among min_gap and others"),
        ("hop_ratio.maximum > 1", "there is no maximum among max"),
        ("max_abs_spacing_error[2] > 1", r"place 2 is beyond a list of 2"),
        ("max_abs_spacing_error > 1", "is a list, no number"),
        ("max_abs_spacing_error.last > 1", "last is looked for in a list"),
        ("min_gap.first > 1", "first is looked for in a single value"),
        ("min_gap[0] > 1", "0 is looked for in a single value"),
        ("max(min_gap) > 1", "that is no list"),
        ("headline", "is a text, neither true nor false"),
        ("headline > 1", "is a text, no number"),
        ("string_stable > 0", "is true or false, no number"),
        ("min_gap", "is a number, neither true nor false"),
        ("max(verdict) < 1", "that is no list"),
    ],
)
def test_what_a_document_does_not_have(text, words):
    with pytest.raises(UserError, match=words) as told:
        Criterion.parse(text).holds(DOCUMENT)
    assert "\n" not in str(told.value)


def test_a_value_may_be_anything_that_a_document_has():
    assert Value.parse("headline").of(DOCUMENT) == "STRING STABLE"
    assert Value.parse("max_abs_spacing_error").of(DOCUMENT) == [3.0, 1.5]
