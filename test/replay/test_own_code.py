"""Own code in a replay: tried before anything starts; what only a bag names is not imported."""

import sys
from pathlib import Path

import pytest

from cacc_platoon.cli import main
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario

VALUES = {"platoon.followers": 3, "run.duration": 1.0}
LAWS = """
class Flat:
    def __init__(self, follower):
        pass

    def command(self, *inputs):
        return 0.0

class Nobody(Flat):
    def command(self, *inputs):
        return float("nan")
"""


@pytest.fixture(autouse=True)
def own_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("of_the_bag", "of_mine"):
        (tmp_path / f"{name}.py").write_text(LAWS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    for name in ("of_the_bag", "of_mine"):
        monkeypatch.delitem(sys.modules, name, raising=False)


def bag(monkeypatch: pytest.MonkeyPatch, laws: dict[int, str]) -> str:
    """Return a run whose recording names laws of some vehicles."""
    overrides = {index: {"controller.law": law} for index, law in laws.items()}
    simulate_run(Scenario.from_values(VALUES, overrides), Path("run"))
    monkeypatch.delitem(sys.modules, "of_the_bag", raising=False)
    return "run"


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """Replay vehicle 2 and return the one line of the refusal."""
    assert main(["replay", *arguments, "--vehicle", "2"]) == 2
    output = capsys.readouterr()
    (line,) = output.err.splitlines()
    assert output.out == ""
    return line


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("controller.law=no_such_module:Law", "No module named 'no_such_module'"),
        ("controller.law=of_mine:absent", "module of_mine has no class or function absent"),
        (
            "vehicle_2.controller.law=of_mine:Nobody",
            "the law of vehicle_2 returned nan in equilibrium",
        ),
    ],
)
def test_a_law_that_is_set_is_tried(monkeypatch, capsys, given, setting, words):
    arguments = [bag(monkeypatch, {}), "--set", setting]
    if given:
        Path("given.yaml").write_text(format_scenario(Scenario.from_values(VALUES)))
        arguments += ["--scenario", "given.yaml"]
    assert words in refusal(capsys, *arguments)


@pytest.mark.parametrize("settings", [(), ("--set", "controller.k_v=0.7")])
def test_a_law_that_only_the_bag_names_is_refused(monkeypatch, capsys, settings):
    line = refusal(capsys, bag(monkeypatch, {2: "of_the_bag:Flat"}), *settings)
    assert "names controller.law = of_the_bag:Flat, code that the replay would run" in line
    assert "of_the_bag" not in sys.modules


@pytest.mark.parametrize("index", [2, 3])
def test_a_law_that_is_set_is_tried_and_no_other(monkeypatch, capsys, index):
    """Neither the one that it replaces nor that of another vehicle."""
    run = bag(monkeypatch, {index: "of_the_bag:Flat"})
    line = refusal(capsys, run, "--set", "controller.law=of_mine:Nobody")
    assert "controller.law = of_mine:Nobody: the law of vehicle_2 returned nan" in line
    assert "of_the_bag" not in sys.modules
