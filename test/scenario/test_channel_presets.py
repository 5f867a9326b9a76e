"""Channels by name: what they are, that the command takes them, and that their digests stay."""

import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.cli import main
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.channel_presets import channel_names, channel_settings
from cacc_platoon.scenario.file import load_scenario, parse_scenario
from cacc_platoon.scenario.parameter import ScenarioError
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph

SHORT = ("platoon.followers=3", "run.duration=12")
LONGER = {"attacked": "run.duration=30"}
DIGESTS = {
    "attacked": "470ea3db37ff202c",
    "cam": "c156d07b5c14cb29",
    "cam_lossy": "6ead485f98373689",
    "gilbert_tamu": "d41bcc6cecf35fd1",
    "ideal": "fdc266e2f400c920",
    "paper": "d6204b345420b09d",
    "sidelink_high": "3c6932a954128d4e",
    "sidelink_low": "ba2377d2bf246b85",
}
EMPTY = "/**:\n  ros__parameters: {}\n"


def scenario(name: str, *settings: str) -> Scenario:
    return parse_scenario(EMPTY, source="test", settings=[*channel_settings(name), *settings])


def test_every_channel_has_its_digest():
    """Of one run of three vehicles: a change here changes recorded runs."""
    assert channel_names() == list(DIGESTS)
    found = {}
    for name in channel_names():
        one = scenario(name, *SHORT, *LONGER.get(name, "").split())
        found[name] = run_digest(recording_of(simulate(one)), Graph.of(one))[:16]
    assert found == DIGESTS


def test_what_they_are():
    assert scenario("paper").v2v == Scenario.from_values({}).v2v
    assert scenario("ideal").v2v.noise == "none"
    low, high = scenario("sidelink_low").v2v, scenario("sidelink_high").v2v
    assert ((low.latency, low.loss), (high.latency, high.loss)) == ((0.025, 0.1), (0.01, 1e-4))
    assert scenario("gilbert_tamu").follower(1).mean_loss == pytest.approx(0.475)


def test_the_command_takes_a_channel_and_set_changes_parts_of_it(tmp_path, capsys):
    file = tmp_path / "one.yaml"
    file.write_text(EMPTY)
    short = [word for text in SHORT for word in ("--set", text)]
    asked = ["--channel", "sidelink_low", "--set", "v2v.loss=0.2", "--runs", "0", *short]
    assert main(["simulate", str(file), "-o", str(tmp_path / "run"), *asked]) == 0
    v2v = load_scenario(tmp_path / "run" / "scenario.yaml").v2v
    assert (v2v.latency, v2v.loss) == (0.025, 0.2)
    capsys.readouterr()
    assert main(["simulate", str(file), "-o", str(tmp_path / "two"), "--channel", "cellular"]) == 2
    said = capsys.readouterr().err
    assert "--channel = 'cellular' is no channel" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "two").exists()


def test_a_path_is_no_name():
    with pytest.raises(ScenarioError, match="is no channel"):
        channel_settings("../channels/paper")
