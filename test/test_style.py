"""Habits that no linter checks: small files, and nothing in the project about where it is made."""

import ast
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
SUFFIXES = {".py", ".md", ".rst", ".yaml", ".toml", ".cfg", ".xml", ".html", ".css", ".js", ""}


def project_files() -> list[Path]:
    """Return the files of the project, tracked or about to be."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [path for name in sorted(names.split("\0")) if name and (path := ROOT / name).is_file()]


FILES = project_files()
MODULES = [path for path in FILES if path.suffix == ".py"]


def test_files_are_small():
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text().splitlines())
        for path in MODULES
        if not path.is_relative_to(ROOT / "test")
    }
    assert {name: length for name, length in lengths.items() if length > 400} == {}


def test_every_test_file_says_what_it_tests():
    tests = [path for path in MODULES if path.name.startswith("test_")]
    assert [path for path in tests if not ast.get_docstring(ast.parse(path.read_text()))] == []


def test_nothing_refers_to_the_machine_it_is_made_on():
    words = [f"/{folder}/" for folder in ("work", "root", "home")] + ["py" + "pi.org"]
    for path in FILES:
        if path.suffix in SUFFIXES and path.name not in ("LICENSE", Path(__file__).name):
            text = path.read_text()
            assert [word for word in words if word in text] == [], path


def test_no_test_is_left_out():
    for path in MODULES:
        if path.is_relative_to(ROOT / "test") and path != Path(__file__):
            text = path.read_text()
            for mark in ("mark.skip", "mark.xfail", "pytest.skip", "pytest.xfail", "time.sleep("):
                assert mark not in text, path
