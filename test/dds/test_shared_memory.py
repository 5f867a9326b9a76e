"""Only what belongs to the dead is removed, and only from shared memory."""

import json
import mmap
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from cacc_platoon.dds import shared_memory
from cacc_platoon.dds.own_folder import process_folder

ONE, TWO = "fastrtps_00000000000000aa", "fastrtps_00000000000000bb"
PORT = "fastrtps_port7411"
BEGIN = """
import fcntl, mmap, pathlib, sys
from cacc_platoon.dds import shared_memory
folder, name, how = sys.argv[1:]
shared_memory.SHARED_MEMORY = pathlib.Path(folder)
if how == "starting":
    shared_memory.note_start()
segment = open(f"{folder}/{name}", "wb+")
segment.truncate(4096)
open(f"{folder}/sem.{name}_mutex", "w").close()
lock = open(f"{folder}/{name}_el", "w")
if how == "mapped":
    memory = mmap.mmap(segment.fileno(), 4096)
else:
    fcntl.flock(lock, fcntl.LOCK_EX)
if how == "noted":
    shared_memory.used_segments = lambda: {name}
    shared_memory.note_segments()
print("there", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for /dev/shm, beside a folder of our own."""
    shm = tmp_path / "shm"
    for path in (shm, tmp_path / "runtime"):
        path.mkdir()
    monkeypatch.setattr(shared_memory, "SHARED_MEMORY", shm)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    return shm


def begin(folder: Path, name: str, how: str) -> "subprocess.Popen[str]":
    """Start a process that makes a segment, which it has noted or not."""
    process = subprocess.Popen(
        [sys.executable, "-c", BEGIN, str(folder), name, how],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "there\n"
    return process


def kill(*processes: "subprocess.Popen[str]") -> None:
    for process in processes:
        process.kill()
        process.wait()


def dead_note(text: str | None = None) -> Path:
    """Return the note of a process that had our number, with a text."""
    own = process_folder()
    assert own is not None
    note = own.with_name(f"{own.name.rpartition('-')[0]}-1") / "note.json"
    note.parent.mkdir()
    if text is not None:
        note.write_text(text)
    return note


def names(*segments: object) -> str:
    return json.dumps({"segments": list(segments), "since": None})


def left(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_segments_of_the_living_stay_and_of_the_dead_go(folder: Path) -> None:
    with begin(folder, ONE, "noted") as living, begin(folder, TWO, "noted") as dead:
        kill(dead)
        assert sorted(shared_memory.sweep().removed) == [TWO, f"{TWO}_el", f"sem.{TWO}_mutex"]
        assert (folder / ONE).exists()
        assert shared_memory.sweep().removed == []
        kill(living)
    assert ONE in shared_memory.sweep().removed
    assert left(folder.parent / "runtime" / "cacc_platoon") == set()


def test_a_process_that_got_the_number_of_a_dead_one_is_not_taken_for_it(folder: Path) -> None:
    note = dead_note(names(ONE))
    (folder / ONE).write_text("")
    assert ONE in shared_memory.sweep().removed
    assert not note.parent.exists()


def test_what_is_mapped_is_found() -> None:
    before = shared_memory.used_segments()
    path = shared_memory.SHARED_MEMORY / f"fastrtps_{os.getpid():016x}"
    path.write_bytes(b"x" * mmap.PAGESIZE)
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ):
            assert shared_memory.used_segments() - before == {path.name}
    finally:
        path.unlink()


def test_what_others_left_is_not_touched(folder: Path) -> None:
    (folder / ONE).write_text("")
    assert shared_memory.sweep() == ([], [])
    assert (folder / ONE).exists()


def test_a_process_killed_while_it_starts_leaves_nothing(folder: Path) -> None:
    (folder / "fastrtps_00000000000000cc").write_text("of another, before")
    os.utime(folder / "fastrtps_00000000000000cc", (0, 0))
    (folder / "fastrtps_other").write_text("no file of Fast DDS")
    with begin(folder, ONE, "starting") as dead, begin(folder, PORT, "mapped") as living:
        with begin(folder, TWO, "locked") as locked:
            kill(dead)
            assert sorted(shared_memory.sweep().removed) == [ONE, f"{ONE}_el", f"sem.{ONE}_mutex"]
            assert {PORT, TWO, "fastrtps_00000000000000cc", "fastrtps_other"} < left(folder)
            kill(locked)
        kill(living)


@pytest.fixture
def victim(tmp_path: Path) -> Iterator[Path]:
    """A file of the user's that has nothing to do with us; it is there afterwards."""
    path = tmp_path / "victim"
    path.write_text("precious")
    yield path
    assert path.read_text() == "precious"


@pytest.mark.parametrize(
    "name",
    ["{}", "../victim", "fastrtps_port1/../../victim", f"{ONE}\n", f"{ONE}/", "", "fastrtps_", 7],
)
def test_a_note_that_names_anything_else_is_dropped(folder: Path, victim: Path, name) -> None:
    note = dead_note(names(name.format(victim) if isinstance(name, str) else name, ONE))
    (folder / ONE).write_text("")
    removed, (line,) = shared_memory.sweep()
    assert removed == []
    assert line.startswith(f"{note}: names ")
    assert line.endswith("which is no segment of Fast DDS; dropped")
    assert "\n" not in line
    assert shared_memory.sweep() == ([], [])


@pytest.mark.parametrize(
    "text",
    [
        *("{}", "[]", "7", "nothing", '{"segments": 1}', '{"segments": [], "since": "x"}', "\0"),
        '{"segments": []}',
        '{"segments": {"a": 1}, "since": null}',
        '{"segments": [], "since": 1' + 400 * "0" + "}",
        "[" * 100_000,
        "[" * 2_000_000,
    ],
)
def test_a_note_that_is_none_is_dropped(folder: Path, text: str) -> None:
    note = dead_note(text)
    removed, (line,) = shared_memory.sweep()
    assert removed == []
    assert line.startswith(f"{note}: is ")
    assert len(line) < 300
    assert shared_memory.sweep() == ([], [])


@pytest.mark.parametrize("since", ["NaN", "Infinity", "-Infinity", "1e300", "-1.0"])
def test_a_moment_that_is_none_removes_nothing(folder: Path, since: str) -> None:
    dead_note(f'{{"segments": [], "since": {since}}}')
    (folder / ONE).write_text("")
    assert shared_memory.sweep() == ([], [])
    assert (folder / ONE).exists()


@pytest.mark.parametrize(
    "make", [lambda note, victim: note.symlink_to(victim), lambda note, _: os.mkfifo(note)]
)
def test_a_note_that_is_no_file_is_not_read(folder: Path, victim: Path, make) -> None:
    note = dead_note()
    victim.write_text(names(ONE))
    make(note, victim)
    (folder / ONE).write_text("")
    removed, (line,) = shared_memory.sweep()
    assert removed == []
    assert line.startswith(f"{note}: ")
    victim.write_text("precious")


@pytest.mark.parametrize(
    "make", [lambda path, victim: path.symlink_to(victim), lambda path, _: path.mkdir()]
)
def test_what_is_no_file_in_shared_memory_stays(folder: Path, victim: Path, make) -> None:
    make(folder / ONE, victim)
    make(folder / f"{TWO}_el", victim)
    (folder / TWO).write_text("")
    dead_note(names(ONE, TWO))
    assert shared_memory.sweep().removed == []
    assert left(folder) == {ONE, TWO, f"{TWO}_el"}


def test_a_note_in_the_temporary_folder_is_nobodys(
    folder: Path, victim: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(folder.parent))
    planted = folder.parent / f"cacc_platoon-{os.getuid()}"
    planted.mkdir()
    (planted / "1.json").write_text(json.dumps({"start": "1", "segments": [str(victim)]}))
    (planted / "2.json").write_text("{}")
    (planted / "stray.json").write_text("{}")
    assert shared_memory.sweep() == ([], [])


def test_without_a_folder_everything_goes_on(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.setenv(name, "/proc")
    monkeypatch.setattr("pwd.getpwuid", lambda _: (_ for _ in ()).throw(KeyError))
    shared_memory.note_start()
    shared_memory.note_segments()
    with shared_memory.own_temporary_files(), shared_memory.cleared_segments():
        assert shared_memory.sweep() == ([], [])


def test_the_free_memory_is_that_of_the_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = os.statvfs(folder)
    free = shared_memory.free_memory()
    assert free is not None
    assert abs(free - state.f_bavail * state.f_frsize) < 2**30
    monkeypatch.setattr(shared_memory, "SHARED_MEMORY", folder / "missing")
    assert shared_memory.free_memory() is None
