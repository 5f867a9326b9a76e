"""The schemas in docs/formats and real documents fit, both ways; every key is explained."""

import contextlib
import copy
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from ruamel.yaml import YAML

from cacc_platoon.analysis import analyse
from cacc_platoon.campaign.answer import document as campaign_document
from cacc_platoon.campaign.check import Outcome
from cacc_platoon.campaign.plan import plan
from cacc_platoon.campaign.trials import Trial
from cacc_platoon.cli import main
from cacc_platoon.cli.simulate import simulate_run
from cacc_platoon.live.picture import Picture, VehicleNow
from cacc_platoon.replay import (
    comparison_document,
    first_difference,
    possible_causes,
    read_node,
    what_if,
    what_if_document,
)
from cacc_platoon.report import metrics_document
from cacc_platoon.reproduction.cases import CASES, case_scenario
from cacc_platoon.reproduction.paper_page import document as paper_document
from cacc_platoon.reproduction.reproduce import reproduce
from cacc_platoon.runs.info import ClockOffset, HostInfo, RunInfo
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.sample_reader import Reading
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.scenario.schema import scenario_schema
from cacc_platoon.supervision.protocol import (
    HostPhase,
    HostState,
    ProtocolError,
    RunPhase,
    RunStatus,
)
from cacc_platoon.supervision.view_message import HostView
from msg_adapters.topics import Graph, VehicleTopics

ROOT = Path(__file__).parents[1]
FORMATS = ROOT / "docs" / "formats"
README = (FORMATS / "README.md").read_text()
SCHEMAS = {
    path.name.partition(".")[0]: json.loads(path.read_text())
    for path in sorted(FORMATS.glob("*.schema.json"))
}
WRITTEN = sorted(SCHEMAS.keys() - {"scenario"})
OTHER_FILE = {"$ref": "metrics.schema.json"}
CRASH = {
    "controller.time_headway": 0.05,
    "platoon.standstill_distance": 0.5,
    "leader.profile": "brake",
    "leader.start": 0.0,
    "leader.deceleration": 9.0,
    "run.duration": 6.0,
    "v2v.noise": "none",
}
SILENT = {
    "v2v.reception": "fallback",
    "v2v.blackouts": (0.2, 1.5),
    "v2v.monitor": "fallback",
    "v2v.false_data": ("2 3 factor=3",),
    "run.duration": 3.0,
    "vehicle.limits": "iso15622",
    "run.timeline": ("1 link_2 v2v.loss=0.5",),
    "run.sync": "wall",
}
DESIGNS = [
    question.split()
    for question in (
        "--rho 5 --tau-max 0.5",
        "--rho 5 --tau-max 0.5 --k-a 0.5 --time-headway 0.95 --k-v 0.63 --k-p 0.009 "
        "--v2v-period 0.2 --recommend --chance 0.01 --human 0.5 0.1 1.4 0.4",
        "--rho 5 --tau-max 0.5 --k-a 0.4 --time-headway 0.95 --k-v 0.63 --k-p 0.009 --explain",
        "--rho 5 --tau-max 0.5 --k-a 0.2 --time-headway 0.6 --k-v 0.63 --k-p 0.009 --reception 0.9 "
        "--predecessors 2 --recommend",
        "--rho 5 --tau-max 0.5 --k-a 0.4 --time-headway 0.95 --k-v 0.63 --k-p 0.1 "
        "--k-effective 0.42",
    )
]
HOST_STATES = [
    HostState(
        run="f00d",
        host="vehicle_2_vehicle",
        pid=4711,
        nodes=("vehicle_2/vehicle",),
        publishes=("/platoon/vehicle_2/pose",),
        subscribes=("/platoon/vehicle_1/pose",),
        records=("/platoon/vehicle_2/pose",),
        part="/tmp/parts/vehicle_2_vehicle",
        phase=phase,
        missing=("vehicle_2/vehicle: no publisher of /platoon/vehicle_1/pose",),
        failure="the disk is full",
        parameters={"vehicle_2/vehicle": {"run.step": 0.01, "vehicle.tau": [0.1, 0.2]}},
        events=(RunEvent(EventKind.COLLISION, 12, "vehicle_2/vehicle"),),
    )
    for phase in HostPhase
]
STATUSES = [
    RunStatus(
        run="f00d",
        phase=phase,
        samples=2001,
        message="no progress for 10 s",
        hosts=(HostInfo("0", 4711, ("vehicle_0/leader",), "east", "/there/host_0"),),
        subscribers={"/platoon/vehicle_0/pose": 2},
    )
    for phase in RunPhase
]

VIEW = HostView("f00d", "0", 12, {"/platoon/vehicle_0/pose": Reading(12, 1.5)})
PICTURE = Picture(
    "/platoon",
    phase="running",
    sample=12,
    samples=2001,
    step=0.01,
    factor=1.5,
    left=10.0,
    events=(RunEvent(EventKind.COLLISION, 12, "vehicle_2/vehicle"),),
    vehicles=(VehicleNow(0), VehicleNow(1, 12, reception="fallback", alarm=True)),
)
TRIALS = [
    Trial(plan(1, 0), Outcome(4.0, 1, state="failed", samples=200), (), None),
    Trial(plan(1, 1), Outcome(60.0), ("did not end within 60 s",), Path("runs/campaign/1-1-kill")),
]


@pytest.fixture(scope="module")
def documents(tmp_path_factory, bags):
    """Return real documents of each format, such that every key occurs."""
    folder = tmp_path_factory.mktemp("documents")
    reports = [analyse(path) for path in recorded(folder, bags)]
    info = json.loads((folder / "noisy" / "run.json").read_text())
    host = HostInfo("0", 4711, ("vehicle_0/leader",))
    offsets = {"0": ClockOffset(-1e-4, 2e-4).to_json()}
    by_clocks = {"hosts": [host.to_json()], "clock_offsets": offsets}
    found = {
        "metrics": [metrics_document(report) for report in reports],
        "run": [info, RunInfo.from_json(info).to_json(), {**info, **by_clocks}],
        "paper": [paper(folder)],
        "replay": list(replays(folder / "noisy")),
        "design": [printed("design", "--json", *question) for question in DESIGNS],
        "layouts": [printed("layout", "--json", str(folder / "noisy"))],
        "campaign": [campaign_document(1, TRIALS)],
        **study(folder / "study"),
        "part": [part(folder / "part")],
        "host_state": [json.loads(state.to_json()) for state in HOST_STATES],
        "event": [
            json.loads(line)
            for line in (folder / "crash" / "events.jsonl").read_text().splitlines()
        ],
        "status": [json.loads(status.to_json()) for status in STATUSES],
        "view": [json.loads(VIEW.to_json())],
        "watch": [PICTURE.to_json(), Picture("/platoon").to_json()],
    }
    return json.loads(json.dumps(found, allow_nan=False))


def recorded(folder: Path, bags) -> Iterator[Path]:
    """Yield a noisy run, one with a collision, one with fallbacks, and a bag that was altered."""
    noisy = bags.scenario({"platoon.followers": 3})
    simulate_run(noisy, folder / "noisy")
    yield folder / "noisy"
    simulate_run(Scenario.from_values(CRASH), folder / "crash")
    yield folder / "crash"
    simulate_run(Scenario.from_values(SILENT), folder / "silent")
    yield folder / "silent"
    topic = VehicleTopics("/platoon", 2).accel
    altered = bags.rewritten(bags.record(noisy), topic, lambda values: values * 2.0)
    yield bags.bag(folder / "altered", noisy, altered)


def paper(folder: Path) -> dict:
    """Return paper.json of runs so short that some statements disagree."""
    reports = {}
    for case in CASES:
        run = folder / case.name
        simulate_run(case_scenario(case, {"run.duration": 2.0}), run)
        reports[case.name] = analyse(run, runs=2)
    return paper_document(reproduce(reports))


def replays(run: Path) -> Iterator[dict]:
    """Yield what a replay says when all is identical, when something differs, and with --set."""
    record = read_node(run, 2)
    same = {s.topic.name: [row.tobytes() for row in s.messages] for s in record.outputs}
    yield comparison_document(record, first_difference(record, same))
    other = {name: [rows[0], *rows[:-1]] for name, rows in same.items()}
    yield comparison_document(record, first_difference(record, other), possible_causes(record))
    settings = ["controller.k_v=0.7"]
    yield what_if_document(record, settings, what_if(record, record.scenario, same))


def printed(*arguments: str) -> dict:
    """Return the object that the command prints."""
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main(arguments) == 0
    return json.loads(out.getvalue())


def study(folder: Path) -> dict:
    """Return what describes a study with a row that fails, a missed criterion and a constant."""
    folder.mkdir()
    (folder / "plan.yaml").write_text(
        "settings: {run.duration: 12.0, platoon.followers: 2}\n"
        "matrix: {leader.profile: [sine, csv]}\ncriteria: [min_gap > 100]\n"
    )
    one = folder / "one"
    made = printed("sweep", str(folder / "plan.yaml"), "-o", str(one), "--json")
    return {"summary": [made], "sweep": [json.loads((one / "sweep.json").read_text())]}


def part(folder: Path) -> dict:
    PartWriter(folder, Graph.of(Scenario()).run_topics).close()
    return json.loads((folder / "topics.json").read_text())


def validator(name: str) -> Draft202012Validator:
    """Return a checker of one format; what another schema describes is checked on its own."""
    schema = copy.deepcopy(SCHEMAS[name])
    if name == "paper":
        assert schema["properties"]["cases"]["additionalProperties"] == OTHER_FILE
        schema["properties"]["cases"]["additionalProperties"] = {"type": "object"}
    return Draft202012Validator(schema)


@pytest.mark.parametrize("name", WRITTEN)
def test_real_documents_are_what_the_schema_says(documents, name):
    for document in documents[name]:
        assert [error.message for error in validator(name).iter_errors(document)] == []
        for case in document.get("cases", {}).values():
            assert [error.message for error in validator("metrics").iter_errors(case)] == []


@pytest.mark.parametrize("name", WRITTEN)
def test_every_key_of_the_schema_occurs(documents, name):
    used: set[object] = set()
    for document in documents[name]:
        note(document, SCHEMAS[name], SCHEMAS[name], used)
    assert {path for path, _ in keys(SCHEMAS[name])} - used == set()


def resolved(schema: dict, root: dict) -> dict:
    """Return the schema that a $ref within one file stands for."""
    reference = schema.get("$ref", "")
    if not reference.startswith("#/$defs/"):
        return schema
    return root["$defs"][reference.removeprefix("#/$defs/")]


def note(value: object, schema: dict, root: dict, used: set[object]) -> None:
    """Add each key of a document, named by where the schema describes it."""
    schema = resolved(schema, root)
    for choice in schema.get("anyOf", ()):
        note(value, choice, root, used)
    if isinstance(value, dict):
        for name, item in value.items():
            if name in schema.get("properties", {}):
                used.add(id(schema["properties"][name]))
                note(item, schema["properties"][name], root, used)
            elif isinstance(other := schema.get("additionalProperties"), dict):
                note(item, other, root, used)
    elif isinstance(value, list) and "items" in schema:
        for item in value:
            note(item, schema["items"], root, used)
    used |= {path for path, node in keys(root) if id(node) in used}


def keys(schema: dict, at: str = "") -> Iterator[tuple[str, dict]]:
    """Yield the path and the schema of every key that a schema names."""
    for name, node in schema.get("properties", {}).items():
        yield f"{at}.{name}", node
        yield from keys(node, f"{at}.{name}")
    for name, node in schema.get("$defs", {}).items():
        yield from keys(node, f"{at}#{name}")
    for word in ("items", "additionalProperties"):
        if isinstance(schema.get(word), dict):
            yield from keys(schema[word], f"{at}[]")


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_key_says_what_it_means_and_every_number_its_unit(name):
    Draft202012Validator.check_schema(SCHEMAS[name])
    assert SCHEMAS[name]["title"]
    assert SCHEMAS[name]["description"]
    for path, node in keys(SCHEMAS[name]):
        assert node.get("description"), path
        if name != "scenario" and "number" in node.get("type", ()):
            assert re.search(r"\[[^\]]+\]|unit", node["description"]), path


@pytest.mark.parametrize("name", WRITTEN)
def test_a_document_with_a_key_more_or_less_is_refused(documents, name):
    [document, *_] = documents[name]
    assert list(validator(name).iter_errors({**document, "surprise": 1}))
    for key in SCHEMAS[name]["required"]:
        less = {k: value for k, value in document.items() if k != key}
        assert list(validator(name).iter_errors(less)), key


@pytest.mark.parametrize("name", WRITTEN)
def test_the_version_is_the_one_of_the_code(documents, name):
    for document in documents[name]:
        assert document["format"] == SCHEMAS[name]["properties"]["format"]["const"]
    [row] = re.findall(rf"^\|.*\| (\d+) \| \[{name}\]", README, re.MULTILINE)
    assert int(row) == SCHEMAS[name]["properties"]["format"]["const"]


@pytest.mark.parametrize(
    ("record", "key", "value"),
    [
        (HOST_STATES[0], "host", "a b"),
        (HOST_STATES[0], "host", "a" * 101),
        (HOST_STATES[0], "pid", 0),
        (HOST_STATES[0], "nodes", "vehicle_1/vehicle"),
        (HOST_STATES[0], "records", [1]),
        (HOST_STATES[0], "phase", "running"),
        (HOST_STATES[0], "failure", "x" * 10_001),
        (HOST_STATES[0], "events", [{"kind": "change", "sample": -1, "node": "a", "text": ""}]),
        (HOST_STATES[0], "events", [{"kind": "rest", "sample": 1, "node": "a", "text": ""}]),
        (HOST_STATES[0], "events", [{"kind": "change", "sample": 1, "node": "", "text": ""}]),
        (HOST_STATES[0], "parameters", {"vehicle_1/vehicle": {"run.step": None}}),
        (HOST_STATES[0], "parameters", {"vehicle_1/vehicle": {"run.step": [[0.01]]}}),
        (VIEW, "host", "a b"),
        (VIEW, "run", ""),
        (VIEW, "sample", -1),
        (VIEW, "readings", {"/platoon/vehicle_0/pose": [1, 2.0]}),
        (VIEW, "readings", {"/platoon/vehicle_0/pose": [1.5, 2.0, 0.0]}),
        (VIEW, "readings", {"/platoon/vehicle_0/pose": [-1, 2.0, 0.0]}),
        (VIEW, "readings", {"/platoon/vehicle_0/pose": [1, "2", 0.0]}),
        (VIEW, "readings", []),
        (STATUSES[0], "run", ""),
        (STATUSES[0], "phase", "up"),
        (STATUSES[0], "sample", -2),
        (STATUSES[0], "samples", None),
        (STATUSES[0], "hosts", [{"name": "0", "nodes": []}]),
        (STATUSES[0], "subscribers", {"/platoon/vehicle_0/pose": -1}),
    ],
)
def test_the_schemas_of_messages_refuse_what_the_software_refuses(record, key, value):
    message = {**json.loads(record.to_json()), key: value}
    with pytest.raises(ProtocolError):
        type(record).from_json(json.dumps(message))
    name = {HostState: "host_state", RunStatus: "status", HostView: "view"}[type(record)]
    assert list(validator(name).iter_errors(message))


def test_the_kinds_of_the_schemas_are_those_of_the_software():
    item = SCHEMAS["host_state"]["properties"]["events"]["items"]
    for schema in (item, SCHEMAS["event"]):
        assert schema["properties"]["kind"]["enum"] == list(EventKind)


@pytest.mark.parametrize(("name", "phases"), [("host_state", HostPhase), ("status", RunPhase)])
def test_the_phases_of_the_schemas_are_those_of_the_software(name, phases):
    assert SCHEMAS[name]["properties"]["phase"]["enum"] == list(phases)


def test_the_schema_of_scenarios_is_made_from_the_parameter_table():
    made = "platoon parameters --schema > docs/formats/scenario.schema.json makes it anew"
    assert SCHEMAS["scenario"] == json.loads(json.dumps(scenario_schema())), made


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda p: p.name)
def test_example_scenarios_fit_their_schema(path):
    document = YAML(typ="safe").load(path.read_text())
    assert list(Draft202012Validator(SCHEMAS["scenario"]).iter_errors(document)) == []


@pytest.mark.parametrize(
    ("values", "wrong"),
    [
        ({"platoon": {"followers": 2}}, False),
        ({"vehicle": {"tau": [0.5, 0.4]}, "run": {"hosts": "per_node"}}, False),
        ({"platoon": {"followers": 0}}, True),
        ({"platoon": {"folowers": 2}}, True),
        ({"v2v": {"noise": "bitz"}}, True),
        ({"v2v": {"rho": 1.0}}, True),
        ({"controller": {"k_v": "high"}}, True),
    ],
)
def test_the_schema_of_scenarios_refuses_what_the_software_refuses(values, wrong):
    text = YAML(typ="safe").load(format_scenario(Scenario())) | {"/**": {"ros__parameters": values}}
    assert bool(list(Draft202012Validator(SCHEMAS["scenario"]).iter_errors(text))) == wrong
