"""What a report leaves behind, and what the command prints."""

import html.parser
import json
import re
import sys
from argparse import Namespace

import pytest

from cacc_platoon.cli import main
from cacc_platoon.cli.judge import conclude
from cacc_platoon.report import metrics_document, report_run, summary
from cacc_platoon.report.tables import look_up
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.table import TABLE
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph, VehicleTopics


class Page(html.parser.HTMLParser):
    """Collects what a test asks a page for."""

    def __init__(self, text):
        super().__init__()
        self.cells, self.figures, self.captions, self.data = {}, 0, 0, ""
        self._cell, self._script, self.first_heading = None, False, ""
        self._heading = False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.figures += tag == "svg"
        self.captions += tag == "figcaption"
        self._script = tag == "script"
        self._heading = tag == "h1"
        if tag == "td" and "data-key" in attrs:
            self._cell = attrs
        for name in ("src", "href", "xlink:href", "srcset", "data"):
            assert attrs.get(name, "#").startswith("#"), (tag, attrs)
        assert tag not in ("link", "iframe", "img", "object", "embed")

    def handle_data(self, data):
        if self._script:
            self.data += data
        if self._heading and data.strip():
            self.first_heading += data
            self._heading = False
        if self._cell is not None:
            self.cells[self._cell["data-key"]] = (data, self._cell.get("data-form"))
            self._cell = None

    def handle_endtag(self, tag):
        self._script = self._script and tag != "script"


@pytest.fixture(scope="module")
def reported(whole_run, tmp_path_factory):
    output = tmp_path_factory.mktemp("report")
    report, _ = report_run(whole_run, runs=5, output=output)
    return report, output


def test_page_needs_nothing_else(reported):
    text = (reported[1] / "report.html").read_text(encoding="utf-8")
    Page(text)
    assert "http" not in text.replace("http-equiv", "")
    assert "@import" not in text
    assert not re.search(r"url\((?!#)", text)
    assert '<meta name="viewport"' in text
    assert "@media print" in text
    assert "prefers-color-scheme: dark" in text


def test_numbers_of_the_page_are_those_of_the_json(reported):
    report, output = reported
    document = json.loads((output / "metrics.json").read_text())
    page = Page((output / "report.html").read_text(encoding="utf-8"))
    assert json.loads(page.data) == document == metrics_document(report)
    assert len(page.cells) > 70
    for key, (shown, form) in page.cells.items():
        value = look_up(document, key)
        assert shown == ("-" if value is None else f"{value:{form}}"), key


def test_page_begins_with_the_verdict(reported):
    text = (reported[1] / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert "String stable" in page.first_heading
    order = ["<h1>", "What the verdict rests on", "<h2>Figures", "<h2>Numbers", "<h2>Scenario"]
    places = [text.index(part) for part in [*order, "<h2>Provenance"]]
    assert places == sorted(places)
    assert page.figures == page.captions >= 12
    for fact in (reported[0].run.digest, "numpy", "libc"):
        assert fact in text


def test_every_figure_names_units_and_is_vector_graphics(reported):
    files = sorted((reported[1] / "figures").glob("*.svg"))
    assert len(files) >= 12
    for file in files:
        svg = file.read_text(encoding="utf-8")
        assert svg.startswith('<svg xmlns="http://www.w3.org/2000/svg"')
        texts = re.findall(r"<!-- (.*?) -->", svg) + re.findall(r">([^<>]+)</text>", svg)
        assert any(re.search(r"\[.+\]$", text) for text in texts), file.name
        assert "<image" not in svg


def test_metrics_json_has_the_agreed_keys(reported):
    metrics = json.loads((reported[1] / "metrics.json").read_text())
    assert len(metrics["max_abs_spacing_error"]) == len(metrics["l2_spacing_error"]) == 3
    assert len(metrics["hop_ratio"]["max"]) == len(metrics["hop_ratio"]["l2"]) == 2
    assert set(metrics["platoon_length"]) == {"initial", "max", "final"}
    assert metrics["min_gap"] > 0
    assert metrics["collision"] is False
    assert set(metrics["noise"]) >= {"mean_w", "min_w", "max_w", "snr_db"}
    assert metrics["verdict"]["string_stable"] is True
    assert "exact test" in metrics["verdict"]["basis"]
    assert "Theorem 2" in metrics["verdict"]["paper"]["basis"]


def test_summary_says_the_verdict_first(reported):
    report = reported[0]
    lines = summary(report, metrics_document(report)).splitlines()
    assert lines[0].startswith("STRING STABLE")
    assert lines[1].startswith("  in the mean over the noise, for every lag up to 0.5 s")
    assert "every E[w] that all links share, |a_i|_2 and |delta_i|_2 do not grow" in lines[1]
    assert "exact test" in lines[2]
    assert any("paper's Theorem 2" in line for line in lines)
    for peak in metrics_document(report)["max_abs_spacing_error"]:
        assert f"{peak:.6f}" in summary(report, metrics_document(report))
    assert report.run.digest in summary(report, metrics_document(report))


def test_json_prints_the_file_and_nothing_else(run_folder, capsys):
    assert main(["report", str(run_folder), "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == json.loads((run_folder / "metrics.json").read_text())
    assert err == ""


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        ([], 0),
        (["controller.time_headway=0.65"], 3),
    ],
)
def test_simulate_and_check(tmp_path, capsys, settings, code):
    file = tmp_path / "short.yaml"
    file.write_text("/**: {ros__parameters: {platoon: {followers: 2}, run: {duration: 12.0}}}\n")
    arguments = ["simulate", str(file), "-o", str(tmp_path / "run"), "--runs", "2"]
    arguments += [part for setting in settings for part in ("--set", setting)]
    assert main([*arguments, "--check"]) == code
    out, err = capsys.readouterr()
    assert out.startswith("NOT STRING STABLE" if settings else "STRING STABLE")
    assert ("warning" in err) == bool(settings)
    info = json.loads((tmp_path / "run" / "run.json").read_text())
    assert info["status"] == "finished"
    assert info["hosts"] == []
    assert info["digest"] in out
    assert main(arguments) == 2  # never overwrites


def alter(folder):
    """Change one value in the bag of a run: the leader's last position, which enters no step."""
    [file] = (folder / "bag").glob("*.mcap")
    content = bytearray(file.read_bytes())
    codec = VehicleTopics("/platoon", 0).pose.codec
    trajectory = read_run(folder / "bag").trajectory
    last = codec.encode(3_000_000_000, trajectory.position[-1, 0])
    at = content.index(last)
    content[at : at + len(last)] = codec.encode(3_000_000_000, trajectory.position[-1, 0] + 1.0)
    file.write_bytes(content)


def fail(folder):
    """Let a run have failed."""
    file = folder / "run.json"
    file.write_text(file.read_text().replace('"finished"', '"failed"'))


@pytest.mark.parametrize(
    ("harm", "headline", "state"),
    [
        (lambda _: None, "STRING STABLE, DATA INTACT: ", "intact"),
        (alter, "STRING STABLE, DATA ALTERED: ", "altered"),
        (fail, "STRING STABLE, RUN FAILED: ", "failed"),
    ],
    ids=["whole", "altered", "failed"],
)
def test_the_headline_and_check_tell_of_design_and_data(run_folder, capsys, harm, headline, state):
    harm(run_folder)
    written = report_run(run_folder)
    assert conclude(written, Namespace(json=False, check=False)) == 0
    capsys.readouterr()
    checked = Namespace(json=False, check=True)
    assert conclude(written, checked) == (0 if state == "intact" else 3)
    out = capsys.readouterr().out
    assert out.startswith(headline)
    assert "\n  data: " in out
    metrics = json.loads((run_folder / "metrics.json").read_text())
    assert metrics["verdict"]["certified"]
    assert metrics["headline"] + ": " == headline
    assert metrics["standing"]["state"] == state
    assert metrics["proven"] == metrics["standing"]["stands"] == (state == "intact")
    page = (run_folder / "report.html").read_text(encoding="utf-8")
    assert ('class="verdict good"' if state == "intact" else 'class="verdict bad"') in page
    assert f"{metrics['standing']['line']}." in page


def test_killed_run_is_finished_first(tmp_path, scenario, capsys):
    """parts/ without a bag is what a killed supervisor leaves; the last message is cut short."""
    folder = RunFolder.create(tmp_path / "run", scenario)
    recording = recording_of(simulate(scenario))
    topics = Graph.of(scenario).run_topics
    part = PartWriter(folder.parts / "host_0", topics)
    for topic in topics:
        content = recording[topic.name].messages[:200].tobytes()
        part.writers[topic.name](content[:-5])
    part.close()
    assert main(["report", str(folder.path), "--json"]) == 0
    metrics = json.loads(capsys.readouterr().out)
    info = json.loads((folder.path / "run.json").read_text())
    assert info["status"] == "failed"
    assert info["message"] == "its process was killed; this is what had been recorded"
    assert metrics["provenance"]["samples"] == 199
    assert metrics["findings"] == [
        "the run failed: its process was killed; this is what had been recorded",
        "the run has 199 samples (1.98 s) of the scenario's 301 (3 s)",
    ]
    assert not folder.parts.exists()


def test_killed_before_anything_was_recorded(tmp_path, scenario, capsys):
    folder = RunFolder.create(tmp_path / "run", scenario)
    assert main(["report", str(folder.path)]) == 2
    assert "before anything was recorded" in capsys.readouterr().err


def test_collision_is_reported_at_the_top(bags, tmp_path):
    """The leader brakes hard and no follower reacts."""
    braking = bags.scenario(
        {
            "leader.profile": "brake",
            "leader.deceleration": 8.0,
            "run.duration": 20.0,
            "controller.k_v": 0.01,
            "controller.k_a": 0.0,
        }
    )
    report, _ = report_run(bags.run(tmp_path / "run", braking).path, runs=0)
    assert report.measured.first_collision
    follower, time = report.measured.first_collision
    assert f"COLLISION of vehicle {follower} at {time:g} s" in summary(
        report, metrics_document(report)
    )
    assert report.headline.startswith("COLLISION, ")
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert '<header class="verdict bad"><h1>&#10007; Collision, ' in page
    assert page.index("<b>Collision</b>") < page.index("What the verdict rests on")


def test_report_that_cannot_be_written(run_folder, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["report", str(run_folder), "-o", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err


# Every parameter at another value than its default.
CHANGED = {
    "run.sync": "wall",
    "run.phases": "random",
    "run.pause_at": -0.5,
    "run.step_samples": 7,
    "run.clock": True,
    "platoon.followers": 2,
    "platoon.first_follower": 4,
    "platoon.predecessors": 2,
    "platoon.standstill_distance": 6.0,
    "platoon.initial_speed": 20.0,
    "platoon.namespace": "/other",
    "vehicle.tau": (0.25, 0.375),
    "vehicle.tau_max": 0.4375,
    "vehicle.limits": "constant",
    "vehicle.max_acceleration": 4.75,
    "vehicle.max_deceleration": 9.75,
    "vehicle.max_jerk": 60.5,
    "vehicle.stops": True,
    "sensing.delay": 0.046875,
    "sensing.range_std": 0.0078125,
    "sensing.range_rate_std": 0.00390625,
    "controller.time_headway": 1.25,
    "controller.k_a": 0.46875,
    "controller.k_v": 0.65625,
    "controller.k_p": 0.015625,
    "controller.law": "changed_parts:law",
    "controller.headway_rate": 0.09375,
    "v2v.rho": 8.0,
    "v2v.noise": "expected",
    "v2v.bit_probabilities": (0.125, 0.8125),
    "v2v.hold": 0.5,
    "v2v.period": 0.1,
    "v2v.phase": 0.04,
    "v2v.latency": 0.02,
    "v2v.send_rule": "cam",
    "v2v.best_effort": True,
    "v2v.cam_check": 0.2,
    "v2v.jitter": 0.015625,
    "v2v.jitter_law": "gamma",
    "v2v.jitter_shape": 3,
    "v2v.in_order": True,
    "v2v.bias": 0.0625,
    "v2v.noise_std": 0.03125,
    "v2v.quantum": 0.125,
    "v2v.saturation": 16.0,
    "v2v.false_data": ("0.5 1 frozen",),
    "v2v.fallback_after": 0.375,
    "v2v.fallback_blend": 1.5,
    "v2v.fallback_return": 2.5,
    "v2v.fallback_headway": 3.5,
    "v2v.monitor": "report",
    "v2v.monitor_window": 1.75,
    "v2v.monitor_margin": 5.5,
    "v2v.monitor_jerk": 12.5,
    "v2v.burst_begin": 0.25,
    "v2v.burst_end": 0.5,
    "v2v.burst_loss": 0.75,
    "v2v.blackouts": (1.0, 2.0),
    "v2v.loss": 0.25,
    "v2v.reception": "zero",
    "v2v.channel": "changed_parts:channel",
    "v2v.receiver": "changed_parts:HalfTrusting",
    "leader.profile": "csv",
    "leader.start": 0.75,
    "leader.amplitude": 0.875,
    "leader.angular_frequency": 0.1875,
    "leader.acceleration": 1.125,
    "leader.hold": 1.375,
    "leader.deceleration": 1.625,
    "leader.final_speed": 1.75,
    "leader.file": "speeds.csv",
    "leader.times": (0.0, 1.5, 3.25),
    "leader.speeds": (20.0, 21.5, 19.5),
    "leader.vehicle": 7,
    "vehicle.length": 4.25,
    "leader.digest": "abc",
    "run.step": 0.02,
    "run.duration": 3.0,
    "run.seed": 77,
    "run.real_time_factor": 2.5,
    "run.hosts": 2,
    "run.spawn": False,
    "run.manual_nodes": ("vehicle_4/vehicle", "vehicle_5/noise_relay"),
    "run.remote_hosts": ("east=3",),
    "run.host_commands": ("east=ssh me@east",),
    "run.timeline": ("1 link_5 v2v.loss=0.375",),
    "run.adjustable": True,
    "run.stop_on_collision": False,
    "run.window": 63,
    "run.start_timeout": 31.5,
    "run.stall_timeout": 11.5,
    "record.command": True,
    "record.spacing_error": True,
    "record.parts": "parts",
}
OWN = {
    "v2v.channel": "",
    "v2v.send_rule": "periodic",
    "controller.k_v": 0.71875,
    "v2v.noise": "bits",
    "v2v.bit_probabilities": (0.34375, 0.5),
}


OWN_PARTS = """
from cacc_platoon.model import ComposedChannel, ContentNoise, IndependentLoss


class law:
    def __init__(self, follower):
        self._law = follower.spacing_policy()

    def command(self, x, v, x_ahead, v_ahead, *received):
        return self._law.command(x, v, x_ahead, v_ahead, received[-1])


class HalfTrusting:
    def __init__(self, follower):
        self._value = 0.0

    def use(self, delivered):
        for _, value in delivered:
            self._value = 0.5 * value
        return self._value


def channel(follower):
    loss = IndependentLoss(follower.v2v.loss, follower.seed, follower.link.key)
    return ComposedChannel([ContentNoise(follower.noise()), loss])
"""


def test_every_parameter_can_be_shown(tmp_path, monkeypatch):
    """Through the command and back from the bag, whatever type a value has."""
    (tmp_path / "changed_parts.py").write_text(OWN_PARTS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    output = tmp_path / "run"
    values = {**CHANGED, "record.directory": str(output)}
    usual = {name for name in TABLE if values.get(name, TABLE[name].default) == TABLE[name].default}
    assert usual == {"run.restarts"}  # which does not go with run.adjustable
    file = tmp_path / "all.yaml"
    file.write_text(format_scenario(Scenario.from_values(values, {5: OWN})))
    assert main(["simulate", str(file)]) == 0
    page = (output / "report.html").read_text(encoding="utf-8")
    text = r'<td class="text">([^<]*)</td><td class="code">([^<]*)</td>'
    shown = dict(re.findall(text, page))
    own = {f"vehicle_5: {name}": value for name, value in OWN.items()}
    for name, value in {**values, **own}.items():
        items = value if isinstance(value, tuple) else (value,)
        words = [f"{i:g}" if isinstance(i, float) else str(i) for i in items]
        # a scenario is resolved when it is written: the table stands for its file
        assert shown[name] == ("" if name == "leader.file" else ", ".join(words)), name


def test_a_loop_whose_peaks_are_out_of_reach_is_judged_all_the_same(tmp_path, capsys):
    """It rings for millions of periods: no L1 norm, but the exact test needs none."""
    file = tmp_path / "short.yaml"
    file.write_text("/**: {ros__parameters: {platoon: {followers: 3}, run: {duration: 2.0}}}\n")
    ringing = ["--set", "controller.k_p=1e6", "-o", str(tmp_path / "run")]
    assert main(["simulate", str(file), *ringing]) == 0
    out = capsys.readouterr().out
    assert out.startswith("COLLISION, STRING STABLE BY DESIGN, CERTIFICATE VOID")
    assert "peaks of a_i grow per hop between followers by a factor of inf at most" in out
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["verdict"]["linf_gain"] is metrics["verdict"]["sure_gain"] is None


@pytest.mark.parametrize(
    ("setting", "check"),
    [
        ("controller.k_p=1e200", True),
        ("vehicle_2.controller.k_p=1e200", True),
        ("controller.k_v=1e200", False),
        ("controller.k_p=1e-300", True),
        ("controller.time_headway=1e200", True),
    ],
)
def test_gains_too_extreme_to_certify_are_run_and_reported(tmp_path, capsys, setting, check):
    """A warning instead of a refusal; pytest turns numpy's warnings into errors."""
    file = tmp_path / "short.yaml"
    file.write_text("/**: {ros__parameters: {platoon: {followers: 3}, run: {duration: 2.0}}}\n")
    arguments = ["simulate", str(file), "--runs", "2", "--set", setting]
    arguments += ["-o", str(tmp_path / "run"), *(["--check"] if check else [])]
    assert main(arguments) == (3 if check else 0)
    out, err = capsys.readouterr()
    assert out.startswith("NOT CERTIFIED")
    assert "undecided: the " in out
    assert re.match("platoon: warning: the gains cannot be certified: the (loop|modes) ", err)
    assert err.count("\n") == 1
    assert "a smaller k_v" not in err  # it may be the other gain that is too large
    text = (tmp_path / "run" / "metrics.json").read_text()
    metrics = json.loads(text, parse_constant=pytest.fail)
    assert metrics["verdict"]["certified"] is False
    assert metrics["verdict"]["l2_gain"] is metrics["verdict"]["linf_gain"] is None
    assert metrics["verdict"]["reason"] in err
    undecided = [one for one in metrics["verdict"]["per_follower"] if not one["decided"]]
    assert len(undecided) == (1 if "vehicle" in setting else 3)
    page = (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert "The gains cannot be certified: the " in page
