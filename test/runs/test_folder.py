"""A run folder is never half a run: it can be finished, or it says why not."""

import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from cacc_platoon.bags.raw import BagError
from cacc_platoon.errors import UserError
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import NO_BAG, ROOM, EndStatus, RunInfo
from cacc_platoon.runs.locate import locate, runs_platoons
from cacc_platoon.runs.parts import PartWriter
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.simulation import simulate
from msg_adapters.topics import Graph

SCENARIO = Scenario.from_values({"run.duration": 10.0, "platoon.followers": 2}, None, "short")
HOLD = """
import sys
from pathlib import Path
from cacc_platoon.runs.folder import RunFolder
folder = RunFolder(Path(sys.argv[1]))
print(folder.hold(), flush=True)
sys.stdin.read()
"""
Usage = namedtuple("Usage", "total used free")


def recorded(path: Path) -> RunFolder:
    """Return a folder whose parts hold a whole run."""
    folder = RunFolder.create(path, SCENARIO)
    part = PartWriter(folder.parts / "host_0", Graph.of(SCENARIO).run_topics)
    for name, record in recording_of(simulate(SCENARIO)).items():
        for message in record.messages:
            part.writers[name](message.tobytes())
    part.close()
    return folder


def test_a_run_that_does_not_fit_on_its_disk_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(2**30, 2**30 - 2**20, 2**20))
    with pytest.raises(UserError, match=r"has 1 MiB free but the run takes up to 3 MiB"):
        RunFolder.create(tmp_path / "run", SCENARIO)
    assert not (tmp_path / "run").exists()


def test_a_finished_folder_holds_the_bag_and_no_parts(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "run")
    info = folder.finish(SCENARIO, folder.recording(), RunInfo())
    assert sorted(p.name for p in folder.path.iterdir()) == ["bag", "run.json", "scenario.yaml"]
    assert set(info.messages.values()) == {1001}
    with Reader(folder.bag) as reader:
        assert reader.message_count == 11 * 1001 + 1


def test_writing_that_is_interrupted_can_be_done_again(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "run")

    def interrupt(done: int, _: int) -> None:
        if done:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        folder.finish(SCENARIO, folder.recording(), RunInfo(), interrupt)
    assert not folder.bag.exists()
    folder.finish(SCENARIO, folder.recording(), RunInfo())
    with Reader(folder.bag) as reader:
        assert reader.message_count == 11 * 1001 + 1


def test_a_message_cut_short_at_the_end_of_a_part_is_left_out(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "run")
    victim = folder.parts / "host_0" / "0003.cdr"
    victim.write_bytes(victim.read_bytes()[:-5])
    lengths = sorted(len(record.messages) for record in folder.recording().values())
    assert lengths == [1000] + [1001] * 10


def said(folder: RunFolder) -> RunInfo:
    """Return what run.json says, which has to be there."""
    info = RunInfo.read(folder.path)
    assert info
    return info


def test_a_new_folder_says_that_it_runs_and_who_runs_it(tmp_path: Path) -> None:
    folder = RunFolder.create(tmp_path / "run", SCENARIO)
    assert said(folder) == folder.begun
    assert (said(folder).status, said(folder).pid) == (EndStatus.RUNNING, os.getpid())
    assert (folder.path / "run.json.new").stat().st_blocks * 512 >= ROOM


def test_a_folder_in_use_is_left_alone_and_one_out_of_use_is_finished(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run").path
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        assert holder.stdout
        assert holder.stdout.readline() == b"True\n"
        with pytest.raises(BagError, match=rf"process {os.getpid()} is at it, since 2.*Wait"):
            locate(path)
        holder.kill()
    assert (path / "parts").is_dir()
    locate(path)
    info = said(RunFolder(path))
    assert info.message == "its process was killed; this is what had been recorded"
    assert (info.status, len(info.digest)) == (EndStatus.FAILED, 64)


@pytest.mark.parametrize(
    ("command_line", "ours"),
    [
        (
            "/opt/cacc_platoon/.venv/bin/python /opt/cacc_platoon/.venv/bin/platoon run",
            True,
        ),
        ("python3 -m cacc_platoon run a.yaml", True),
        ("/opt/ws/lib/cacc_platoon/supervisor --ros-args", True),
        ("python3 -c import sys; from cacc_platoon.cli import main", True),
        ("python3 /opt/cacc_platoon/__main__.py run", True),
        ("/opt/cacc_platoon/.venv/bin/python -m pytest -m unit", False),
        ("python3 -m pytest cacc_platoon/theory", False),
        ("vim /opt/cacc_platoon/platoon.py", False),
    ],
)
def test_a_process_is_ours_by_what_it_runs(command_line: str, ours: bool) -> None:
    """Not by the folder that the software or its interpreter is in."""
    arguments = command_line.replace(" ", "\0")
    if "-c" in command_line:
        arguments = command_line.replace(" -c ", "\0-c\0")
    assert runs_platoons(f"{arguments}\0".encode()) is ours


def test_an_edited_scenario_frees_no_folder_that_is_in_use(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "run")
    file = folder.path / "scenario.yaml"
    file.write_text(file.read_text().replace("a", "a"))
    shutil.copy(file, tmp_path / "edited")
    (tmp_path / "edited").replace(file)
    script = "import sys; from cacc_platoon.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", script, "report", str(folder.path)], capture_output=True, check=False
    )
    assert done.returncode == 2
    assert b"is at it, since 2" in done.stderr
    assert folder.parts.is_dir()


def test_a_copy_of_a_run_that_goes_on_is_called_one(tmp_path: Path) -> None:
    script = f"""
import sys
from pathlib import Path
import cacc_platoon.cli
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_folder import recorded
folder = recorded(Path(sys.argv[1]))
print("recorded", flush=True)
sys.stdin.read()
"""
    path, copy, later = (tmp_path / name for name in ("run", "copy", "later"))
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout
        assert process.stdout.readline() == b"recorded\n"
        for target in (copy, later):
            shutil.copytree(path, target)
        locate(copy)
        process.kill()
    info = said(RunFolder(copy))
    assert info.status is EndStatus.INTERRUPTED
    assert info.message.startswith("this is a copy that was made while it went on; ")
    locate(later)
    assert said(RunFolder(later)).message.startswith("its process was killed; ")


def test_a_run_that_ended_while_its_bag_was_written_ends_as_it_did(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "run")
    path = folder.path

    def interrupt(done: int, _: int) -> None:
        if done:
            raise KeyboardInterrupt

    for status, message in ((EndStatus.FAILED, "no progress for 2 s"), (EndStatus.FINISHED, "")):
        with pytest.raises(KeyboardInterrupt):
            folder.finish(SCENARIO, folder.recording(), RunInfo(status, message), interrupt)
        assert said(folder).message.endswith(NO_BAG)
        assert said(folder).with_bag() == said(folder).with_bag().with_bag()
        assert said(folder).with_bag().message == message
    locate(path)
    assert (said(RunFolder(path)).status, said(RunFolder(path)).message) == ("finished", "")


def test_what_is_recorded_is_missed_when_it_is_gone(tmp_path: Path) -> None:
    part = PartWriter(tmp_path / "part", Graph.of(SCENARIO).run_topics)
    part.flush()
    (tmp_path / "part").rename(tmp_path / "moved")
    with pytest.raises(FileNotFoundError, match="moved"):
        part.flush()
    (tmp_path / "moved" / "0003.cdr").unlink()
    with pytest.raises(FileNotFoundError, match="deleted"):
        part.flush()
    part.close()
