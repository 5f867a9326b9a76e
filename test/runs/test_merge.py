"""Parts from other machines: the bag that lacked them is made whole, to the same digest."""

import dataclasses
import shutil

import numpy as np
import pytest

from cacc_platoon.bags.digest import run_digest
from cacc_platoon.errors import UserError
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import ELSEWHERE, EndStatus, HostInfo, InfoError, RunInfo
from cacc_platoon.runs.locate import KILLED, locate
from cacc_platoon.runs.merge import merge_parts
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.recorded_run import read_run
from msg_adapters.topics import Graph

HOSTS = ("east=2", "west=3")


@pytest.fixture(scope="module")
def scenario(bags):
    return bags.scenario({"run.remote_hosts": HOSTS})


@pytest.fixture(scope="module")
def recording(bags, scenario):
    return bags.record(scenario)


@pytest.fixture
def parts(tmp_path, scenario, recording):
    """The parts of three hosts; the local one holds what no other does."""
    graph, made = Graph.of(scenario), {}
    for name, vehicles in (("0", (0, 1)), ("east", (2,)), ("west", (3,))):
        nodes = [node for node in scenario.nodes if node.vehicle in vehicles]
        topics = [topic for node in nodes for topic in graph.recorded_with(node)]
        made[name] = tmp_path / "elsewhere" / f"host_{name}"
        writer = PartWriter(made[name], topics, "f00d")
        for topic in topics:
            writer.writers[topic.name](recording[topic.name].messages.tobytes())
        writer.close()
    return made


@pytest.fixture
def run(tmp_path, scenario, parts):
    """A run that has ended well, but for the parts of two hosts."""
    folder = RunFolder.create(tmp_path / "run", scenario, "f00d")
    shutil.copytree(parts["0"], folder.parts / "host_0")
    hosts = tuple(HostInfo(name, 1, (), machine=f"m_{name}") for name in ("0", "east", "west"))
    there = {name: str(parts[name]) for name in ("east", "west")}
    info = dataclasses.replace(folder.begun, status=EndStatus.FINISHED, samples=scenario.samples)
    info = dataclasses.replace(info, hosts=hosts).without_parts(there)
    folder.finish(scenario, folder.recording(), info)
    return folder.path


def read_info(run):
    info = RunInfo.read(run)
    assert info is not None
    return info


def test_a_bag_without_some_parts_is_readable_and_says_so(run, scenario):
    info = read_info(run)
    assert info.status is EndStatus.FAILED
    assert info.message.startswith(f"{ELSEWHERE}: host east, ")
    assert "host_west on m_west" in info.message
    read = read_run(run / "bag", run)
    assert np.isfinite(read.trajectory.position[:, :2]).all()
    assert any("vehicle_2" in finding for finding in read.findings)


def test_parts_that_are_added_one_by_one_make_the_bag_whole(run, parts, scenario, recording):
    half = merge_parts(run, [parts["west"]])
    assert half.status is EndStatus.FAILED
    assert [host.name for host in half.hosts if host.part] == ["east"]
    whole = merge_parts(run, [parts["east"]])
    assert (whole.status, whole.message) == (EndStatus.FINISHED, "")
    assert whole.digest == run_digest(recording, Graph.of(scenario))
    assert read_run(run / "bag", run).findings == ()
    assert sorted(path.name for path in run.iterdir()) == ["bag", "run.json", "scenario.yaml"]
    with pytest.raises(UserError, match="its bag lacks no part"):
        merge_parts(run, [parts["east"]])


def test_a_run_that_failed_stays_failed(run, parts):
    info = read_info(run)
    failed = dataclasses.replace(info, message=f"no progress for 10 s; {info.message}")
    failed.write(run)
    done = merge_parts(run, [parts["west"], parts["east"]])
    assert (done.status, done.message) == (EndStatus.FAILED, "no progress for 10 s")


def test_parts_of_a_run_that_was_killed_can_be_added_after_its_report(tmp_path, scenario, parts):
    folder = RunFolder.create(tmp_path / "killed", scenario, "f00d")
    shutil.copytree(parts["0"], folder.parts / "host_0")
    dataclasses.replace(folder.begun, pid=2**22, status=EndStatus.RUNNING).write(folder.path)
    bag, _ = locate(folder.path)
    assert np.isnan(read_run(bag, folder.path).trajectory.position[:, 2]).all()
    merge_parts(folder.path, [parts["east"]])
    done = merge_parts(folder.path, [parts["west"]])
    assert done.status is EndStatus.FAILED
    assert KILLED in done.message
    assert np.isfinite(read_run(bag, folder.path).trajectory.position).all()
    assert not folder.parts.exists()


@pytest.mark.parametrize(
    ("which", "words"),
    [
        ("0", "/platoon/vehicle_0/pose is in the run already"),
        ("nothing", "is no part, it has no topics.json"),
        ("other", "is of run 0ther, not of f00d"),
        ("strange", "/platoon/vehicle_9/pose is no topic of this run"),
    ],
)
def test_what_is_no_part_of_the_run_is_refused(run, parts, tmp_path, which, words):
    parts["nothing"] = tmp_path
    for name, old, new in (("other", "f00d", "0ther"), ("strange", "vehicle_2", "vehicle_9")):
        parts[name] = shutil.copytree(parts["east"], tmp_path / name)
        index = parts[name] / "topics.json"
        index.write_text(index.read_text().replace(old, new))
    before = (run / "run.json").read_text()
    with pytest.raises(UserError) as error:
        merge_parts(run, [parts["west"], parts[which]])
    assert words in str(error.value)
    assert (run / "run.json").read_text() == before


def test_only_a_run_folder_takes_parts(tmp_path, parts):
    with pytest.raises(UserError, match="is no run folder"):
        merge_parts(tmp_path, [parts["east"]])
    (tmp_path / "run.json").write_text("{")
    with pytest.raises((UserError, InfoError), match="Give an intact run folder"):
        merge_parts(tmp_path, [parts["east"]])


def test_a_part_of_which_not_all_was_brought_over_is_refused(run, parts, scenario):
    [first, *_] = sorted(parts["east"].glob("*.cdr"))
    first.write_bytes(first.read_bytes()[: first.stat().st_size // 2])
    before = read_info(run)
    with pytest.raises(
        UserError, match=f"of {scenario.samples} samples. Bring all of the part over"
    ):
        merge_parts(run, [parts["east"]])
    assert read_info(run) == before
    assert RunFolder(run).parts.is_dir()
