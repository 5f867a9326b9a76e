"""docs/security.md names a test for every claim, and each of them exists."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "security.md").read_text()
REFERENCE = re.compile(r"`(test_\w+\.py)::(test_\w+)`")
SECTIONS = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", PAGE, re.M | re.S))


def names_in(name: str) -> set[str]:
    """Return the tests of the files of a name."""
    found: set[str] = set()
    for path in (ROOT / "test").rglob(name):
        nodes = ast.walk(ast.parse(path.read_text()))
        found |= {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    return found


@pytest.mark.parametrize(("file", "test"), sorted(set(REFERENCE.findall(PAGE))))
def test_a_test_that_is_named_exists(file: str, test: str) -> None:
    assert test in names_in(file)


@pytest.mark.parametrize("section", SECTIONS)
def test_every_section_names_tests(section: str) -> None:
    assert REFERENCE.search(SECTIONS[section])


def test_every_row_and_every_promise_names_tests() -> None:
    rows = [line for line in PAGE.splitlines() if re.match(r"\| (?!what |-)", line)]
    assert len(rows) > 15
    last = SECTIONS["What is not there to be misused"]
    promises = re.findall(r"^- .*?(?=^- |\Z)", last, re.M | re.S)
    assert len(promises) == 3
    assert [one for one in (*rows, *promises) if not REFERENCE.search(one)] == []
