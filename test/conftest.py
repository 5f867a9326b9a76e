"""What every test needs before ROS or matplotlib is imported: a home of its own, strict fields."""

import os
import re
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import settings
from rosbags.rosbag2 import CompressionFormat, StoragePlugin, Writer

from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.bags.write import typestore, write_bag
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.text import encode_string
from msg_adapters.topics import PlatoonTopics

ROOT = Path(__file__).parents[1]

# The same examples every time, at any speed of the machine; a test that needs many takes a multiple
# of max_examples. To look for new ones: pytest --hypothesis-profile=new
settings.register_profile("project", derandomize=True, deadline=None, max_examples=20)
settings.register_profile("quick", derandomize=True, deadline=None, max_examples=12)
settings.register_profile("few", derandomize=True, deadline=None, max_examples=3)
settings.register_profile("new", deadline=None)
settings.load_profile("project")

_home = tempfile.TemporaryDirectory(prefix="cacc_platoon_test_", ignore_cleanup_errors=True)
os.environ["ROS_LOG_DIR"] = _home.name
os.environ["XDG_RUNTIME_DIR"] = _home.name
os.environ["MPLCONFIGDIR"] = _home.name
os.environ["MPLBACKEND"] = "agg"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

WHOLE = tuple(f"cacc_platoon.{room}" for room in ("cli", "design", "figures", "replay", "report"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test as unit, report, ros or system; pyproject.toml says what they mean."""
    for item in items:
        item.add_marker(kind_of(item.path))


@cache
def kind_of(path: Path) -> str:
    """Return the marker of a file's tests: by its folder, otherwise by what it imports."""
    if path.is_relative_to(ROOT / "test" / "system"):
        return "system"
    if needs_ros(path):
        return "ros"
    return "report" if any(name.startswith(WHOLE) for name in imported(path)) else "unit"


@cache
def needs_ros(path: Path) -> bool:
    """Return whether a file, or one of ours that it imports, imports rclpy at its top."""
    names = imported(path)
    ours = [ROOT / name.replace(".", "/") for name in names]
    files = [path.with_suffix(".py") for path in ours] + [path / "__init__.py" for path in ours]
    return "rclpy" in {name.partition(".")[0] for name in names} or any(
        needs_ros(file) for file in files if file.is_file()
    )


@cache
def imported(path: Path) -> frozenset[str]:
    """Return the modules that a file imports at its top."""
    text = re.sub(
        "^from cacc_platoon import ", "import cacc_platoon.", path.read_text(), flags=re.M
    )
    return frozenset(re.findall(r"^(?:from|import) ([\w.]+)", text, re.M))


@pytest.fixture(scope="session")
def copy_source() -> Callable[[Path], None]:
    """Return a function that copies the project's files, those that git knows or would add."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout

    def copy(target: Path) -> None:
        for name in filter(None, listing.split("\0")):
            if (ROOT / name).is_file():
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, target / name)

    return copy


SHORT = {"platoon.followers": 3, "run.duration": 3.0, "leader.start": 0.5, "leader.amplitude": 2.0}


def short_scenario(more=None):
    return Scenario.from_values({**SHORT, **(more or {})})


def record(scenario):
    return recording_of(simulate(scenario))


def make_run(path, scenario):
    """Write a run folder as `platoon simulate` does."""
    folder = RunFolder.create(path, scenario)
    folder.finish(scenario, record(scenario), RunInfo())
    return folder


def make_bag(path, scenario, recording, custom=None):
    """Write messages as they are, faults included, without run folder and digest."""
    write_bag(
        path,
        recording,
        step_ns=scenario.step_ns,
        depth=10,
        scenario_topic=PlatoonTopics(scenario.platoon.namespace).scenario,
        scenario_text=format_scenario(scenario),
        custom_data=custom or {},
    )
    return path


def make_foreign_bag(
    path, scenario, recording, plugin=StoragePlugin.SQLITE3, *, with_scenario=True, compression=None
):
    """Write a bag as another tool would: topic by topic, with log times that differ from stamps."""
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compression:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        if with_scenario:
            topic = PlatoonTopics(scenario.platoon.namespace).scenario
            connection = writer.add_connection(topic, "std_msgs/msg/String", typestore=typestore())
            writer.write(connection, 1_000, encode_string(format_scenario(scenario)))
        for name, record in recording.items():
            connection = writer.add_connection(name, record.type_name, typestore=typestore())
            for k, row in enumerate(record.messages):
                writer.write(connection, 5_000_000_000 + k * scenario.step_ns, row.tobytes())
    return path


def edited(recording, topic, edit):
    """Return the recording with the rows of one topic replaced by `edit(rows)`."""
    record = recording[topic]
    return {**recording, topic: TopicRows(record.type_name, edit(np.array(record.messages)))}


def rewritten(recording, topic, change):
    """Return the recording with the values of one topic replaced by `change(values)`."""

    def edit(rows):
        return topic.codec.encode_many(
            topic.codec.stamps(rows), change(topic.codec.values(rows).copy())
        )

    return edited(recording, topic.name, edit)


@pytest.fixture(scope="session")
def bags():
    return SimpleNamespace(
        scenario=short_scenario,
        record=record,
        run=make_run,
        bag=make_bag,
        foreign=make_foreign_bag,
        edited=edited,
        rewritten=rewritten,
    )


@pytest.fixture(scope="session")
def scenario():
    return short_scenario()


@pytest.fixture(scope="session")
def recording(scenario):
    return record(scenario)


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory, scenario):
    """A run folder; not to be changed."""
    return make_run(tmp_path_factory.mktemp("runs") / "whole", scenario).path


@pytest.fixture
def run_folder(whole_run, tmp_path):
    """A run folder that the test may change."""
    return shutil.copytree(whole_run, tmp_path / "run")
