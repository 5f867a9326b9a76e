"""The README says what the code says."""

import re
from pathlib import Path

from cacc_platoon.cli import VERBS
from cacc_platoon.cli.parameters import markdown_table

README = (Path(__file__).parents[1] / "README.md").read_text()


def test_the_parameter_table_is_the_one_of_the_code() -> None:
    found = re.search(
        r"<!-- platoon parameters --markdown -->\n(.*)\n<!-- end of parameters -->", README, re.S
    )
    assert found, "the markers of the parameter table are gone"
    assert found[1] == markdown_table()


def test_every_verb_is_described() -> None:
    described = re.findall(r"^\| `(\w+)` \|", README, re.M)
    assert [verb for verb in VERBS if verb not in described] == []
