"""Only what belongs to the dead is removed."""

import json
import mmap
import os
import subprocess
import sys
from pathlib import Path

import pytest

from cacc_platoon.dds import shared_memory

HOLD = """
import fcntl, sys
folder, name = sys.argv[1:]
lock = open(f"{folder}/{name}_el", "w")
fcntl.flock(lock, fcntl.LOCK_EX)
from cacc_platoon.dds import shared_memory
shared_memory.SHARED_MEMORY = shared_memory.Path(folder)
shared_memory.used_segments = lambda: {name}
shared_memory.note_segments()
print("noted", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for /dev/shm, and a temporary folder of its own for the notes."""
    monkeypatch.setattr(shared_memory, "SHARED_MEMORY", tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def hold(folder: Path, name: str) -> "subprocess.Popen[str]":
    """Start a process that owns a segment and has noted it."""
    (folder / name).write_text("")
    (folder / f"sem.{name}_mutex").write_text("")
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(folder), name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(folder)},
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == "noted\n"
    return holder


def test_segments_of_the_living_stay_and_of_the_dead_go(folder: Path) -> None:
    with hold(folder, "fastrtps_aaaa") as living, hold(folder, "fastrtps_bbbb") as dead:
        dead.kill()
        dead.wait()
        assert sorted(shared_memory.sweep()) == [
            "fastrtps_bbbb",
            "fastrtps_bbbb_el",
            "sem.fastrtps_bbbb_mutex",
        ]
        assert (folder / "fastrtps_aaaa").exists()
        assert shared_memory.sweep() == []
        living.kill()
        living.wait()
    assert "fastrtps_aaaa" in shared_memory.sweep()


def test_a_process_that_got_the_number_of_a_dead_one_is_not_taken_for_it(folder: Path) -> None:
    notes = folder / f"cacc_platoon-{os.getuid()}"
    notes.mkdir()
    note = notes / f"{os.getpid()}.json"
    note.write_text(json.dumps({"start": "1", "segments": ["fastrtps_cccc"]}))
    (folder / "fastrtps_cccc").write_text("")
    assert "fastrtps_cccc" in shared_memory.sweep()
    assert not note.exists()


def test_what_is_mapped_is_found() -> None:
    before = shared_memory.used_segments()
    path = shared_memory.SHARED_MEMORY / f"fastrtps_test_{os.getpid()}"
    path.write_bytes(b"x" * mmap.PAGESIZE)
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ):
            assert shared_memory.used_segments() - before == {path.name}
    finally:
        path.unlink()


def test_what_others_left_is_not_touched(folder: Path) -> None:
    (folder / "fastrtps_dddd").write_text("")
    assert shared_memory.sweep() == []
    assert (folder / "fastrtps_dddd").exists()
