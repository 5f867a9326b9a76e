"""README, CONTRIBUTING and the pages of docs/ name files, commands and parameters that exist."""

import argparse
import importlib
import re
from functools import cache
from pathlib import Path

import pytest

from cacc_platoon.cli import VERBS
from cacc_platoon.scenario.table import FORMER_NAMES, SNR_DB, TABLE

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
PAGES += sorted(page for room in ("docs", "examples") for page in (ROOT / room).rglob("*.md"))
PARAMETERS = {*TABLE, SNR_DB.name, *FORMER_NAMES}
GROUPS = {name.partition(".")[0] for name in TABLE}
TOP = [path.name for path in ROOT.iterdir() if path.is_dir() and not path.name.startswith(".")]
PACKAGE = [ROOT / "cacc_platoon", ROOT / "msg_adapters"]
SOURCE = {path: path.read_text() for folder in PACKAGE for path in folder.rglob("*.py")}
FILES = [*ROOT.glob("*.py"), *SOURCE]
FILES += [file for room in ("test", "examples") for file in (ROOT / room).rglob("*.py")]
NOT_IN_THE_PROJECT = {"install", "log", "build", "runs"}  # made by tools and runs
OTHER_FLAGS = {  # of pytest, ROS nodes and `ros2 bag play`
    *("-m", "-p", "--params-file", "--delay", "--rate", "--topics", "--wait-for-all-acked"),
    "--qos-profile-overrides-path",
}


def code_in(text: str) -> list[str]:
    """Return the code of a page: its blocks line by line, continued lines joined, and its spans."""
    text = text.replace("\\\n", " ")
    fenced = re.findall(r"^```\w*\n(.*?)^```$", text, re.M | re.S)
    rest = re.sub(r"^```\w*\n.*?^```$", "", text, flags=re.M | re.S)
    blocks = [line.strip() for block in fenced for line in block.splitlines()]
    blocks += re.findall(r"^ {4,}(\S.*)$", rest, re.M)
    return blocks + re.findall(r"`([^`\n]+)`", rest)


def wrong_paths(code: str, page: Path) -> list[str]:
    """Return what looks like a file or folder of the project and is none."""
    if re.fullmatch(r"\w+\.py", code):
        return [] if any(file.name == code for file in FILES) else [code]
    wrong = []
    for word in re.split(r"[\s\"'=]+", code):
        path = word.partition("::")[0].rstrip(",.;:)")
        first = path.split("/")[0]
        inside = re.fullmatch(r"[\w.-]+(/[\w.-]+)+/?", path) and first not in NOT_IN_THE_PROJECT
        if inside and (first in TOP or path.endswith(".py")):
            places = (ROOT, ROOT / "cacc_platoon", page.parent)
            wrong += [] if any((place / path).exists() for place in places) else [path]
    return wrong


def wrong_names(code: str) -> list[str]:
    """Return modules and their members, and members of classes, that do not exist."""
    wrong = []
    for name in re.findall(r"(?<![\w/.])(?:cacc_platoon|msg_adapters)(?:\.\w+)+", code):
        parts = name.split(".")
        if parts[-1] in ("xml", "yaml", "launch"):
            continue
        while parts and not (found := module("/".join(parts))):
            parts.pop()
        rest = name.split(".")[len(parts) :]
        if len(rest) > 1 or any(not re.search(rf"\b{one}\b", found) for one in rest):
            wrong.append(name)
    for owner, member in re.findall(r"^([A-Z][a-z]\w*)\.(\w+)$", code):
        files = [text for text in SOURCE.values() if re.search(rf"^class {owner}\b", text, re.M)]
        if not any(re.search(rf"\b{member}\b", text) for text in files):
            wrong.append(code)
    return wrong


def module(path: str) -> str:
    """Return the text of a module, empty where there is none."""
    file, package = ROOT / f"{path}.py", ROOT / path / "__init__.py"
    return SOURCE.get(file) or (package.read_text() or "#" if package.is_file() else "")


def wrong_parameters(code: str) -> list[str]:
    """Return what looks like a parameter and is none."""
    names = re.findall(
        rf"(?<![\w/.])(?:vehicle_\d+\.)?((?:{'|'.join(GROUPS)})\.[a-z]\w*)\b(?![.(])", code
    )
    return [name for name in names if name not in PARAMETERS and name != "run.json"]


def wrong_commands(code: str) -> list[str]:
    """Return commands of platoon, make and `ros2 run` that do not exist, and flags they lack."""
    known = OTHER_FLAGS.union(*map(flags_of, VERBS))
    wrong = [flag for flag in re.findall(r"^--?[a-z][\w-]*", code) if flag not in known]
    verb = "|".join(VERBS)
    for line in re.split(r"&&|;|\||  #", code):
        given = re.match(rf"\s*(?:\S*\bplatoon )?({verb})((?: .*)?)$", line)
        if given and (line.split()[0] != given[1] or re.match(" -", given[2])):
            flags = re.findall(r"(?<=\s)--?[a-z][\w-]*", given[2])
            wrong += [f"{given[1]} {flag}" for flag in flags if flag not in flags_of(given[1])]
        unknown = re.match(r"\s*(?:\S*/)?platoon ([a-z]\w*)", line)
        if unknown and unknown[1] not in VERBS:
            wrong.append(line)
        node = re.match(r"\s*ros2 run cacc_platoon (\w+)", line)
        if node and node[1] not in executables():
            wrong.append(line)
        launch = re.match(r"\s*ros2 launch cacc_platoon (\S+)", line)
        if launch and not (ROOT / "launch" / launch[1]).is_file():
            wrong.append(line)
        target = re.match(r"\s*make ([a-z-]+)", line)
        if target and not re.search(rf"^{target[1]}:", (ROOT / "Makefile").read_text(), re.M):
            wrong.append(line)
    return wrong


@cache
def flags_of(verb: str) -> set[str]:
    """Return the flags of one verb of the command."""
    parser = argparse.ArgumentParser()
    importlib.import_module(f"cacc_platoon.cli.{verb}").add_arguments(parser)
    return set(re.findall(r"(?<![\w-])--?[a-z][\w-]*", parser.format_help()))


@cache
def executables() -> set[str]:
    """Return what `ros2 run` can start."""
    text = (ROOT / "setup.py").read_text()
    found = re.search(r"^NODES = \(([^)]*)\)", text, re.M)
    assert found
    return {"platoon", "supervisor", "host", *re.findall(r'"(\w+)"', found[1])}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text())
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_names_exists(page: Path) -> None:
    wrong = []
    for code in code_in(page.read_text()):
        wrong += wrong_paths(code, page) + wrong_names(code)
        wrong += wrong_parameters(code) + wrong_commands(code)
    assert wrong == []


@pytest.mark.parametrize(
    "code",
    [
        "model/controls.py",
        "test_nothing.py",
        "config/paper_d.yaml",
        "cacc_platoon/rooms",
        "python test/benchmark/bench_nothing.py",
        "cacc_platoon.design.nothing",
        "from cacc_platoon.nodes.executables import vehicle",
        "Follower.unheard",
        "run.by_feet",
        "--set vehicle_3.controller.k_x=1",
        "platoon judge RUN",
        ".venv/bin/platoon run config/paper_a.yaml --fast",
        "platoon design --rho 5 && platoon run mine.yaml -q",
        "report --open",
        "--fast",
        "make everything",
        "ros2 launch cacc_platoon everything.launch.py",
        "ros2 run cacc_platoon radio --ros-args",
    ],
)
def test_what_does_not_exist_is_found(code: str) -> None:
    page = PAGES[0]
    found = [wrong_paths(code, page), wrong_names(code), wrong_parameters(code)]
    assert any([*found, wrong_commands(code)])


def test_the_layout_has_every_room() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text()
    layout = page.partition("\n## Layout\n")[2].partition("\n## ")[0]
    rooms = {path.parent.name for path in ROOT.glob("cacc_platoon/*/__init__.py")}
    assert set(re.findall(r"(\w+)/(?=\s)", layout)) == {"cacc_platoon", "msg_adapters", *rooms}


def test_every_design_note_is_in_the_index() -> None:
    folder = ROOT / "docs" / "design"
    index = (folder / "README.md").read_text()
    notes = {path.name for path in folder.glob("*.md")} - {"README.md"}
    assert set(re.findall(r"\]\((\w+\.md)\)", index)) == notes
