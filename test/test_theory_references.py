"""References to docs/theory.md and to the paper's equations: the number must fit the name.

A reference gives the number and what stands there, `docs/theory.md, section 3 (The exact test)`, so
that a wrong number, or a heading that was moved, is seen.
"""

import re
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
THEORY = (ROOT / "docs" / "theory.md").read_text()
CODE = [
    path
    for folder in ("cacc_platoon", "msg_adapters", "test", "examples")
    for path in sorted((ROOT / folder).rglob("*.py"))
    if path != Path(__file__)
]
PLAIN = {"__init__", "errors"}
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


class Theory(NamedTuple):
    """What can be cited: headings by section, sections by theorem, names by equation."""

    headings: dict[str, str]
    theorems: dict[str, str]
    equations: dict[str, str]


def read_theory(page: str) -> Theory:
    """Return the headings, theorems and the paper's equations of a page."""
    headings = dict(re.findall(r"^## (\d+)\. (.+)$", page, re.M))
    theorems: dict[str, str] = {}
    for part in re.split(r"^## ", page, flags=re.M)[1:]:
        section = part.partition(".")[0]
        theorems |= dict.fromkeys(re.findall(r"\*\*Theorem ([A-Z])\.?\*\*", part), section)
    found = re.search(
        r"^The paper's equations that the code cites, by number: (.+?)\.\n\n", page, re.M | re.S
    )
    assert found, "the list of the paper's equations is gone"
    return Theory(headings, theorems, dict(re.findall(r"\((\d+)\) ([^,]+)", flat(found[1]))))


def flat(text: str) -> str:
    """Return a text with comment signs and line breaks as single spaces."""
    return re.sub(r"\s+(# )?", " ", text)


def wrong_references(text: str, theory: Theory) -> list[str]:
    """Return the references of a Python file that name no place, or another one than they say."""
    text = flat(text)
    wrong = []
    for rest in re.findall(r"docs/theory\.md(?=(.{,80}))", text):
        section = re.match(r", section (\d+) \(([^)]+)\)", rest)
        theorem = re.match(r", Theorem ([A-Z]) \(section (\d+)\)", rest)
        if section and theory.headings.get(section[1]) == section[2]:
            continue
        if theorem and theory.theorems.get(theorem[1]) == theorem[2]:
            continue
        wrong.append(f"docs/theory.md{rest}")
    for number, rest in re.findall(r"(?i:equation) \((\d+)\)(.{,40})", text):
        name = theory.equations.get(number)
        if name is None or not rest.startswith((f", {name}", f" ({name})")):
            wrong.append(f"equation ({number}){rest}")
    return wrong


KNOWN = read_theory(THEORY)


def test_the_page_is_read():
    assert KNOWN.headings["3"] == "The exact test"
    assert KNOWN.theorems["A"] == "3"
    assert KNOWN.equations["5"] == "noise factor"
    assert list(KNOWN.headings) == [str(n + 1) for n in range(len(KNOWN.headings))]


@pytest.mark.parametrize("path", CODE, ids=lambda path: str(path.relative_to(ROOT)))
def test_references_lead_to_what_they_name(path):
    assert wrong_references(path.read_text(), KNOWN) == []


@pytest.mark.parametrize(
    "path",
    [
        path
        for path in CODE
        if path.parent == ROOT / "cacc_platoon" / "theory" and path.stem not in PLAIN
    ],
    ids=lambda path: path.stem,
)
def test_every_file_of_the_theory_says_where_it_is_derived(path):
    assert "docs/theory.md, " in flat(path.read_text())


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_into_the_page_lead_to_a_heading(path):
    anchors = {anchor(f"{number}. {text}") for number, text in KNOWN.headings.items()}
    links = re.findall(r"\[section (\d+)\]|\[theory\.md, section (\d+)\]", path.read_text())
    assert {a or b for a, b in links} <= KNOWN.headings.keys()
    found = re.findall(r"section (\d+)\]\([\w./]*theory\.md#([\w-]+)\)", path.read_text())
    assert [
        link for link in found if link[1] not in anchors or not link[1].startswith(link[0])
    ] == []


def anchor(heading: str) -> str:
    """Return the anchor that Markdown makes of a heading."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize(
    "text",
    [
        "see docs/theory.md",
        "docs/theory.md, section 3",
        "docs/theory.md, section 4 (The exact test)",
        "docs/theory.md, section 99 (The exact test)",
        "docs/theory.md, Theorem F",
        "docs/theory.md, Theorem F (section 3)",
        "docs/theory.md, Theorem Z (section 3)",
        "the cap, equation (18)",
        "equation (18), largest k_a",
        "equation (99), largest k_a",
    ],
)
def test_a_wrong_reference_is_seen(text):
    assert wrong_references(text, KNOWN) != []


@pytest.mark.parametrize(
    "text",
    [
        "docs/theory.md, section 3 (The exact\n    test)",
        "# docs/theory.md, section\n# 3 (The exact test)",
        "docs/theory.md, Theorem F (section 5)",
        "equation (16), largest k_a",
    ],
)
def test_a_right_reference_passes(text):
    assert wrong_references(text, KNOWN) == []
