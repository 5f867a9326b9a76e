"""Host states and run statuses: every record comes back from its text; no other text gets in."""

import dataclasses
import json
import os

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cacc_platoon.runs.info import HostInfo
from cacc_platoon.scenario.run_event import EventKind, RunEvent
from cacc_platoon.supervision.json_fields import MAX_CHARACTERS, MAX_INTEGER, MAX_TEXT
from cacc_platoon.supervision.protocol import (
    VERSION,
    HostPhase,
    HostState,
    ProtocolError,
    RunPhase,
    RunStatus,
    sendable,
)

HOST = HostState(
    run="f00d",
    host="vehicle_2_vehicle",
    pid=4711,
    nodes=("vehicle_2/vehicle",),
    publishes=("/platoon/vehicle_2/pose",),
    subscribes=("/platoon/vehicle_1/pose", "/platoon/vehicle_1/twist"),
    records=("/platoon/vehicle_2/pose",),
    part="/tmp/parts/2",
    phase=HostPhase.FAILED,
    missing=("vehicle_2/vehicle: no publisher of /platoon/vehicle_1/pose",),
    failure="the disk is full",
    parameters={"vehicle_2/vehicle": {"run.step": 0.01, "run.seed": 7, "vehicle.tau": [0.1, 0.2]}},
    events=(RunEvent(EventKind.COLLISION, 12, "vehicle_2/vehicle"),),
    answers=1_700_000_000_000_000_000,
    answered=1_700_000_000_000_000_321,
)
STATUS = RunStatus(
    run="f00d",
    phase=RunPhase.MATCHING,
    sample=12,
    samples=2001,
    message="",
    hosts=(HostInfo("0", 4711, ("vehicle_0/leader",)),),
    subscribers={"/platoon/vehicle_0/pose": 2},
    sent=1_700_000_000_000_000_000,
)
BOTH = pytest.mark.parametrize("record", [HOST, STATUS], ids=["host state", "run status"])

FEW = settings(max_examples=15)

names = st.from_regex(r"[A-Za-z0-9]{1,30}(_[A-Za-z0-9]{1,30}){0,2}", fullmatch=True)
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=40)
lists = st.lists(texts, max_size=5).map(tuple)
pids = st.integers(1, MAX_INTEGER)
scalars = (
    st.booleans()
    | st.integers(-MAX_INTEGER, MAX_INTEGER)
    | st.floats(allow_nan=False, allow_infinity=False)
    | texts
)
parameters = st.dictionaries(texts, st.dictionaries(texts, scalars | st.lists(scalars)))
host_states = st.builds(
    HostState,
    run=texts,
    host=names,
    pid=pids,
    nodes=lists,
    publishes=lists,
    subscribes=lists,
    records=lists,
    part=texts,
    phase=st.sampled_from(HostPhase),
    missing=lists,
    failure=texts,
    parameters=parameters,
)
run_statuses = st.builds(
    RunStatus,
    run=texts.filter(bool),
    phase=st.sampled_from(RunPhase),
    sample=st.integers(-1, MAX_INTEGER),
    samples=st.integers(0, MAX_INTEGER),
    message=texts,
    hosts=st.lists(st.builds(HostInfo, names, pids, lists), max_size=3).map(tuple),
    subscribers=st.dictionaries(texts, st.integers(0, MAX_INTEGER), max_size=5),
)
values = st.recursive(
    st.none() | scalars, lambda inner: st.lists(inner) | st.dictionaries(texts, inner)
)


def changed(record: HostState | RunStatus, **fields: object) -> str:
    """Return the text of a record with some fields replaced."""
    return json.dumps({**json.loads(record.to_json()), **fields})


def reason(record: HostState | RunStatus, text: str) -> str:
    """Return why a text is refused, which is one short line."""
    with pytest.raises(ProtocolError) as refusal:
        type(record).from_json(text)
    line = str(refusal.value)
    assert "\n" not in line
    assert len(line) < 250
    line.encode()
    return line


@FEW
@given(host_states)
def test_every_host_state_comes_back(state: HostState) -> None:
    assert HostState.from_json(state.to_json()) == state


@FEW
@given(run_statuses)
def test_every_run_status_comes_back(status: RunStatus) -> None:
    assert RunStatus.from_json(status.to_json()) == status


@BOTH
def test_the_keys_are_those_of_the_fields_and_the_format(record: HostState | RunStatus) -> None:
    """The wire format: a change of these lists is a change of VERSION."""
    assert VERSION == 4
    keys = {
        HostState: "format run host pid nodes publishes subscribes records part phase missing "
        "failure parameters events answers answered machine",
        RunStatus: "format run phase sample samples message hosts subscribers start sent scenario",
    }
    assert list(json.loads(record.to_json())) == keys[type(record)].split()
    assert [field.name for field in dataclasses.fields(record)] == keys[type(record)].split()[1:]


@BOTH
@FEW
@given(text=st.text() | values.map(json.dumps))
def test_any_other_text_is_refused_by_the_one_error(
    record: HostState | RunStatus, text: str
) -> None:
    reason(record, text)


@BOTH
@FEW
@given(data=st.data())
def test_any_field_of_any_value_is_taken_or_refused_by_the_one_error(
    record: HostState | RunStatus, data: st.DataObject
) -> None:
    key = data.draw(st.sampled_from(list(json.loads(record.to_json()))))
    text = changed(record, **{key: data.draw(values)})
    try:
        taken = type(record).from_json(text)
    except ProtocolError:
        reason(record, text)
    else:
        assert type(record).from_json(taken.to_json()) == taken


@BOTH
def test_a_field_that_is_missing_is_named(record: HostState | RunStatus) -> None:
    fields = json.loads(record.to_json())
    for key in fields:
        rest = {name: value for name, value in fields.items() if name != key}
        assert reason(record, json.dumps(rest)) == f"the message has no {key}"


@BOTH
def test_a_key_that_is_not_known_is_passed_over(record: HostState | RunStatus) -> None:
    assert type(record).from_json(changed(record, colour="red")) == record


@BOTH
@pytest.mark.parametrize("version", [1, 3, 5, 10**6])
def test_another_version_says_so_and_what_to_do(
    record: HostState | RunStatus, version: int
) -> None:
    line = reason(record, changed(record, format=version))
    assert line == (
        f"the message is of format {version}, but this version of cacc_platoon understands "
        "format 4. Use the same version of cacc_platoon for all nodes"
    )


@pytest.mark.parametrize("version", [0, -1, True, 1.0, "1", None, [1]])
def test_a_version_that_is_no_version_is_refused(version: object) -> None:
    assert reason(HOST, changed(HOST, format=version)).startswith("format is ")


@pytest.mark.parametrize("bracket", ["[", '{"format":', '{"nodes":['])
def test_endless_nesting_is_refused(bracket: str) -> None:
    assert reason(HOST, bracket * 100_000) == "the message is not JSON that can be read"


def test_nesting_in_a_parameter_is_refused() -> None:
    deep: object = 1
    for _ in range(100):
        deep = [deep]
    line = reason(HOST, changed(HOST, parameters={"vehicle_1/vehicle": {"run.step": deep}}))
    assert line == "'run.step' is a list, not the value of a parameter"


def test_a_message_beyond_all_size_is_not_even_read() -> None:
    text = HOST.to_json() + " " * MAX_CHARACTERS
    assert reason(HOST, text) == f"the message has {len(text)} characters, over {MAX_CHARACTERS}"


def test_the_largest_host_there_can_be_fits() -> None:
    """All 1001 nodes and 2003 topics of a platoon of 501 vehicles in one process."""
    topics = tuple(f"/{'p' * 150}/vehicle_{i}/v2v/accel" for i in range(2003))
    nodes = tuple(f"vehicle_{i}/noise_relay" for i in range(1001))
    state = dataclasses.replace(
        HOST, nodes=nodes, publishes=topics, subscribes=topics, records=topics
    )
    assert len(state.to_json()) < MAX_CHARACTERS / 2
    assert HostState.from_json(state.to_json()) == state


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("run", 3, "run is 3, not a text"),
        ("run", None, "run is null, not a text"),
        ("host", "", "host is '', not the name of a host (letters, digits, underscores)"),
        ("host", "a b", "host is 'a b', not the name of a host (letters, digits, underscores)"),
        ("host", "x/../y", "host is 'x/../y', not the name of a host (letters, digits, under"),
        ("host", "é", "host is 'é', not the name of a host"),
        ("host", "a" * 101, "host is 'aaaaaaaaaaaaaaaaaaaaaaaaaaaaaa', not the name of a host"),
        ("host", "a__b", "host is 'a__b', not the name of a host"),
        ("host", "_a", "host is '_a', not the name of a host"),
        ("host", "a_", "host is 'a_', not the name of a host"),
        ("host", "a\n", "host is 'a\\n', not the name of a host"),
        ("pid", True, "pid is true, not a whole number from 1 on"),
        ("pid", 0, "pid is 0, not a whole number from 1 on"),
        ("pid", -1, "pid is -1, not a whole number from 1 on"),
        ("pid", 1.0, "pid is 1.0, not a whole number from 1 on"),
        ("pid", 10**400, "pid is an endless number, not a whole number from 1 on"),
        ("pid", "4711", "pid is '4711', not a whole number from 1 on"),
        ("nodes", "vehicle_1", "nodes is 'vehicle_1', not a list"),
        ("nodes", {"a": 1}, "nodes is an object, not a list"),
        ("nodes", ["a", 1], "an item of nodes is 1, not a text"),
        ("nodes", [["a"]], "an item of nodes is a list, not a text"),
        ("phase", "asleep", "phase is 'asleep', not one of up, matched, failed, closed"),
        ("phase", "running", "phase is 'running', not one of up, matched, failed, closed"),
        ("phase", 1, "phase is 1, not a text"),
        ("failure", "x" * 10_001, "failure is a text of 10001 characters, over 10000"),
        ("failure", "\ud800", "failure is a text with characters that nobody can print"),
        ("part", "/tmp/\0", "part is a text with characters that nobody can print"),
        ("parameters", [], "parameters is a list, not an object"),
        ("parameters", {"vehicle_1/vehicle": 3}, "'vehicle_1/vehicle' is 3, not an object"),
        ("parameters", {"\ud800": {}}, "a name in parameters is a text with characters that"),
        ("parameters", {"n": {"p": None}}, "p is null, not the value of a parameter"),
        ("parameters", {"n": {"p": {}}}, "p is an object, not the value of a parameter"),
        ("parameters", {"n": {"p": [[]]}}, "p is a list, not the value of a parameter"),
        ("parameters", {"n": {"p": 10**400}}, "p is an endless number, not the value of a para"),
        ("parameters", {"n": {"p": float("nan")}}, "p is nan, not the value of a parameter"),
        ("parameters", {"n": {"p": float("-inf")}}, "p is -inf, not the value of a parameter"),
        ("parameters", {"n": {"p" * 99: None}}, f"'{'p' * 30}' is null, not the value of a"),
    ],
)
def test_a_host_state_of_other_types_is_refused_by_name(
    field: str, value: object, expected: str
) -> None:
    assert reason(HOST, changed(HOST, **{field: value})).startswith(expected)


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("run", "", "run is '', not a text that is not empty"),
        ("phase", "up", "phase is 'up', not one of waiting, matching, running, finished, failed"),
        ("sample", -2, "sample is -2, not a whole number from -1 on"),
        ("sample", False, "sample is false, not a whole number from -1 on"),
        ("samples", None, "samples is null, not a whole number from 0 on"),
        ("message", ["why"], "message is a list, not a text"),
        ("hosts", {}, "hosts is an object, not a list"),
        ("hosts", ["0"], "a host is '0', not an object"),
        ("hosts", [{"name": "0", "nodes": []}], "a host has no pid"),
        ("hosts", [{"name": "0", "pid": -1, "nodes": []}], "pid is -1, not a whole number from"),
        ("hosts", [{"name": "", "pid": 1, "nodes": []}], "name is '', not the name of a host"),
        ("hosts", [{"name": "0", "pid": 1, "nodes": [0]}], "an item of nodes is 0, not a text"),
        ("subscribers", [], "subscribers is a list, not an object"),
        ("subscribers", {"/a/b": -1}, "'/a/b' is -1, not a whole number from 0 on"),
        ("subscribers", {"/a/b": "1"}, "'/a/b' is '1', not a whole number from 0 on"),
        ("subscribers", {"x" * 10_001: 1}, "a name in subscribers is a text of 10001 characters"),
    ],
)
def test_a_run_status_of_other_types_is_refused_by_name(
    field: str, value: object, expected: str
) -> None:
    assert reason(STATUS, changed(STATUS, **{field: value})).startswith(expected)


def test_a_number_that_overflows_is_refused() -> None:
    text = HOST.to_json().replace("0.01", "1e999")
    assert reason(HOST, text) == "'run.step' is inf, not the value of a parameter"


@pytest.mark.parametrize("text", ["nonsense", "", "{", "[1,", "\ud800", "9" * 5000])
def test_what_is_not_json_is_refused(text: str) -> None:
    assert reason(STATUS, text) == "the message is not JSON that can be read"


@pytest.mark.parametrize("text", ["null", "[]", "3", '"text"', "true", "1e999"])
def test_json_that_is_no_object_is_refused(text: str) -> None:
    assert "not an object" in reason(STATUS, text)


@pytest.mark.slow
@given(st.text())
def test_what_is_sendable_arrives_as_it_is(text: str) -> None:
    sent = dataclasses.replace(HOST, failure=sendable(text))
    assert HostState.from_json(sent.to_json()) == sent


def test_a_file_name_in_another_encoding_can_be_sent() -> None:
    name = os.fsdecode(b"/tmp/data\xe9")
    assert sendable(f"{name}: cannot be written") == "/tmp/data?: cannot be written"
    assert len(sendable("x" * 10**6)) == MAX_TEXT


def test_only_finished_and_failed_runs_have_ended() -> None:
    assert [phase for phase in RunPhase if phase.ended] == [RunPhase.FINISHED, RunPhase.FAILED]
