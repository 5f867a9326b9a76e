"""The rule of versions: nothing counts as the oldest, older is read, newer is refused."""

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.formats import Format

THIRD = Format("answer.json", 3)


@pytest.mark.parametrize(("found", "version"), [(None, 0), (1, 1), (2, 2), (3, 3)])
def test_older_ones_are_read(found, version):
    assert THIRD.check(found, "a/answer.json") == version


def test_a_newer_one_is_refused_in_one_line():
    with pytest.raises(UserError) as refusal:
        THIRD.check(4, "a/answer.json")
    line = str(refusal.value)
    assert line.startswith("a/answer.json: format 4 of answer.json is newer than 3, the newest")
    assert line.endswith("Read it with the version that wrote it, or a newer one.")
    assert "\n" not in line


@pytest.mark.parametrize("found", ["1", 1.0, True, 0, -1, [], {}, float("nan")])
def test_what_is_no_version_is_refused(found):
    with pytest.raises(UserError, match=r"must be a whole number >= 1"):
        THIRD.check(found, "a/answer.json")
