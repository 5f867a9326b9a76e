"""Channels and laws by name: what cannot be used is refused in one line, before anything starts."""

import sys

import pytest

from cacc_platoon.cli import main
from cacc_platoon.scenario import Scenario, ScenarioError

CODE = """
from cacc_platoon.model import ComposedChannel

def raising(follower):
    raise RuntimeError("not today\\nnor tomorrow")

def nothing(follower):
    return object()

def perfect(follower):
    return ComposedChannel([])

number = 3

class Liar:
    prompt = True
    longest_delay = 0

    def __init__(self, follower):
        pass

    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return type(good)(*(part[1:] for part in good))

class Leaving(Liar):
    def delivery(self, start, stop):
        raise SystemExit(0)

    def command(self, *inputs):
        raise SystemExit(0)

class Spoiled(Liar):
    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return good._replace(factor=good.factor * float("nan"))

class Flat(Liar):
    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return good._replace(source=good.source.reshape(1, -1))

class Halves(Liar):
    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return good._replace(sample=good.sample + 0.5)

class Pair(Liar):
    def delivery(self, start, stop):
        return tuple(ComposedChannel([]).delivery(start, stop))[:2]

class Endless(Liar):
    longest_delay = None

class Fractional(Liar):
    longest_delay = 2.0

class Backwards(Liar):
    longest_delay = -3

class Undecided(Liar):
    prompt = "yes"

class Shy(Liar):
    @property
    def prompt(self):
        raise RuntimeError("not now")

class Text(Liar):
    def command(self, *inputs):
        return "1.0"

class Nobody(Liar):
    def command(self, *inputs):
        return float("nan")

class Late(Liar):
    prompt = False

    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return good._replace(source=good.source - 2)
"""


@pytest.fixture(autouse=True)
def own_code(tmp_path, monkeypatch):
    (tmp_path / "my_code.py").write_text(CODE)
    (tmp_path / "leaving_code.py").write_text("raise SystemExit(0)\n")
    (tmp_path / "broken_code.py").write_text("1 / 0\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    sys.modules.pop("my_code", None)


WRONG = [
    ("no_such_module:Thing", "No module named 'no_such_module'; the run would lack it"),
    ("my_code:absent", "module my_code has no class or function absent"),
    ("my_code:number", "module my_code has no class or function number"),
    ("my_code:raising", "raised RuntimeError: not today nor tomorrow when it was made"),
    ("my_code:nothing", "makes a object without"),
    ("broken_code:Thing", "raised ZeroDivisionError: division by zero when it was imported"),
    ("leaving_code:Thing", "raised SystemExit: 0 when it was imported"),
    ("my_code", "must be module:Class"),
    ("os.path.join(1):x", "must be module:Class"),
]


@pytest.mark.parametrize("name", ["v2v.channel", "controller.law"])
@pytest.mark.parametrize(("text", "words"), WRONG)
def test_what_cannot_be_used_is_refused(name, text, words):
    with pytest.raises(ScenarioError) as refusal:
        Scenario.from_values({name: text}).check_own_code()
    assert words in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_nothing_is_started_and_no_folder_is_left(verb, tmp_path, capsys):
    (tmp_path / "s.yaml").write_text(
        "/**:\n  ros__parameters: {v2v: {channel: 'my_code:nothing'}}\n"
    )
    assert main([verb, "s.yaml", "-o", "out"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Liar", "it says that it is prompt and delivers"),
        ("Late", "where samples 0 to"),
        ("Leaving", "it raised SystemExit: 0"),
        ("Spoiled", "its factor of the packet of sample 0 is nan"),
        ("Flat", "source of its delivery is int64 of shape (1, 101), not a list of whole numbers"),
        ("Halves", "sample of its delivery is float64 of shape (101,), not a list of whole"),
        ("Pair", "its delivery is not source, sample and factor"),
        ("Endless", "its longest_delay is None, no whole number >= 0"),
        ("Fractional", "its longest_delay is 2.0, no whole number >= 0"),
        ("Backwards", "its longest_delay is -3, no whole number >= 0"),
        ("Undecided", "its prompt is 'yes', neither True nor False"),
        ("Shy", "RuntimeError: not now"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_a_channel_that_does_not_keep_its_promise_is_named(verb, name, words, tmp_path, capsys):
    (tmp_path / "s.yaml").write_text(
        "/**:\n  ros__parameters: {run: {duration: 1.0}, v2v: {channel: 'my_code:" + name + "'}}\n"
    )
    assert main([verb, "s.yaml", "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert "v2v.channel = my_code:" + name in error
    assert words in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Leaving", "raised SystemExit: 0 in equilibrium at 25 m/s"),
        ("Text", "raised TypeError: must be real number, not str"),
        ("Nobody", "returned nan"),
    ],
)
@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_a_law_that_gives_no_command_is_named(verb, name, words, tmp_path, capsys):
    (tmp_path / "s.yaml").write_text(
        "/**:\n  ros__parameters: {controller: {law: 'my_code:" + name + "'}}\n"
    )
    assert main([verb, "s.yaml", "-o", "out"]) == 2
    error = capsys.readouterr().err
    assert f"controller.law = my_code:{name}: the law of vehicle_1" in error
    assert words in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_no_folder_is_left_by_a_law_that_fails_later(tmp_path, capsys):
    (tmp_path / "later.py").write_text(
        "class Law:\n"
        "    def __init__(self, follower):\n"
        "        self.calls = 0\n"
        "    def command(self, *inputs):\n"
        "        self.calls += 1\n"
        "        return 0.0 if self.calls == 1 else 1 / 0\n"
    )
    (tmp_path / "s.yaml").write_text("/**:\n  ros__parameters: {controller: {law: 'later:Law'}}\n")
    assert main(["simulate", "s.yaml", "-o", "out"]) == 2
    assert "the control law of vehicle 1 raised ZeroDivisionError" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    sys.modules.pop("later", None)


def test_a_replay_tries_the_code_that_its_scenario_names(run_folder, tmp_path, capsys):
    scenario = (run_folder / "scenario.yaml").read_text()
    assert "law: ''" in scenario
    (tmp_path / "s.yaml").write_text(scenario.replace("law: ''", "law: my_code:Text"))
    assert main(["replay", str(run_folder), "--vehicle", "2", "--scenario", "s.yaml"]) == 2
    error = capsys.readouterr().err
    assert "controller.law = my_code:Text" in error
    assert len(error.splitlines()) == 1
