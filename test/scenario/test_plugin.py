"""Channels and laws by name: what cannot be used is refused in one line, before anything starts."""

import re
import sys

import pytest

from cacc_platoon.analysis import analyse
from cacc_platoon.cli import main
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.errors import UserError
from cacc_platoon.report import metrics_document, summary
from cacc_platoon.scenario import Scenario, ScenarioError
from cacc_platoon.simulation import simulate
from cacc_platoon.stepping.lockstep import LockstepRelay
from cacc_platoon.sweep import evaluate

CODE = """
import numpy as np
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
        return good.pick(slice(1, None))

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

class Keyed(Liar):
    prompt = False

    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        kept = np.random.default_rng(start).random(stop - start) > 0.3
        return good.pick(kept)

class Far(Liar):
    prompt = False
    longest_delay = 10**30

    def delivery(self, start, stop):
        return ComposedChannel([]).delivery(start, stop)

class Twice(Far):
    longest_delay = 0

    def delivery(self, start, stop):
        good = ComposedChannel([]).delivery(start, stop)
        return good.pick(np.repeat(np.arange(stop - start), 2))

class Prompt(Far):
    prompt = True

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

class Half:
    def __init__(self, follower):
        self._law = follower.spacing_policy()

    def command(self, x, v, x_ahead, v_ahead, received):
        return 0.5 * self._law.command(x, v, x_ahead, v_ahead, received)

class Deaf(Liar):
    def use(self, delivered):
        return float("nan") if list(delivered) else 0.0

class Shouting(Liar):
    def use(self, delivered):
        raise ValueError("too loud")

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


@pytest.mark.parametrize("name", ["v2v.channel", "v2v.receiver", "controller.law"])
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
    [("Deaf", "returned nan"), ("Shouting", "raised ValueError: too loud")],
)
def test_a_reception_that_does_not_what_it_must_is_named(name, words):
    own = {"v2v.receiver": f"my_code:{name}", "run.duration": 1.0}
    with pytest.raises(ScenarioError, match=f"v2v.receiver = my_code:{name}: the reception of"):
        Scenario.from_values(own).check_own_code()
    with pytest.raises(ScenarioError) as refusal:
        Scenario.from_values(own).check_own_code()
    assert words in str(refusal.value)


def test_a_channel_that_depends_on_how_it_is_asked_is_named():
    long = {"run.duration": 100.0, "platoon.followers": 1, "v2v.channel": "my_code:Keyed"}
    with pytest.raises(UserError, match="depends on how many samples it is asked for at a time"):
        Scenario.from_values(long).check_own_code()


@pytest.mark.parametrize("name", ["Far", "Twice", "Prompt"])
def test_channels_that_keep_their_promise_are_run_recorded_and_reported(name, tmp_path):
    """However far they look back, whether they lose nothing at all or deliver twice."""
    scenario = Scenario.from_values(
        {"run.duration": 1.0, "platoon.followers": 2, "v2v.channel": f"my_code:{name}"}
    )
    scenario.check_own_code()
    run, got = simulate(scenario), []
    folder = simulate_run(scenario, tmp_path / "out")
    relay = LockstepRelay(scenario.follower(1), scenario, lambda *packet: got.append(packet))
    for k, sent in enumerate(run.acceleration[:, 0]):
        relay.take(k * scenario.step_ns, sent)
    assert len(got) == scenario.samples * (2 if name == "Twice" else 1)
    report = analyse(folder.path)
    assert report.run.findings == ()
    assert [link.loss for link in report.measured.reception] == [0.0, 0.0]


def test_noisy_runs_of_custom_code_are_refused_before_anything_starts(tmp_path, capsys):
    text = "/**:\n  ros__parameters: {v2v: {channel: 'my_code:perfect'}}\n"
    (tmp_path / "s.yaml").write_text(text)
    assert main(["simulate", "s.yaml", "-o", "out", "--runs", "5"]) == 2
    assert "--runs 5: v2v.channel = my_code:perfect is custom code" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("result", "words"),
    [("None", "TypeError: returned object"), ("float('nan')", "ValueError: returned nan")],
)
def test_a_law_without_a_command_gives_no_row(result, words, tmp_path):
    (tmp_path / "no_law.py").write_text(
        f"class Law:\n    def __init__(self, follower): pass\n"
        f"    def command(self, *inputs): return {result}\n"
    )
    try:
        with pytest.raises(UserError, match=f"law of vehicle 1 raised {re.escape(words)}"):
            evaluate(Scenario.from_values({"run.duration": 1.0, "controller.law": "no_law:Law"}))
    finally:
        sys.modules.pop("no_law", None)


def test_the_expectation_run_is_said_to_lack_custom_code(tmp_path):
    scenario = Scenario.from_values({"run.duration": 1.0, "platoon.followers": 2}).with_values(
        {"vehicle_2.controller.law": "my_code:Half"}
    )
    report = analyse(simulate_run(scenario, tmp_path / "out").path)
    named = "controller.law = my_code:Half"
    document = metrics_document(report)
    assert document["expected_without"] == [named]
    assert f"expectation run without {named}" in summary(report, document)
    assert not report.verdict.equal_links
    assert not any("departs" in reason for reason in report.verdict.void)


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
