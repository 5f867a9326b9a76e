"""The name of a platoon in a domain: one process of this user holds it, and only while it lives."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from cacc_platoon.dds.platoon_lock import PlatoonLock

HOLD = (
    "import sys; from cacc_platoon.dds.platoon_lock import PlatoonLock; "
    "print(PlatoonLock('/platoon', {'ROS_DOMAIN_ID': '7'}).taken_by() or 'held', flush=True); "
    "sys.stdin.read()"
)
HERE = {"ROS_DOMAIN_ID": "7"}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Keep the locks of this test to itself."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", None)
    yield tmp_path
    tempfile.tempdir = None


def test_one_process_holds_a_name_until_it_is_gone() -> None:
    with subprocess.Popen(
        [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout
        assert other.stdout.readline() == "held\n"
        lock = PlatoonLock("/platoon", HERE)
        assert lock.taken_by() == f"process {other.pid} of this machine runs it"
        other.kill()
        other.wait()
        assert lock.taken_by() == ""
    lock.drop()


def test_a_name_that_is_dropped_is_free() -> None:
    first, second = PlatoonLock("/platoon", HERE), PlatoonLock("/platoon", HERE)
    assert first.taken_by() == ""
    assert first.taken_by() == ""
    assert second.taken_by() == f"process {os.getpid()} of this machine runs it"
    first.drop()
    assert second.taken_by() == ""
    second.drop()


@pytest.mark.parametrize(
    ("prefix", "environment"),
    [
        ("/other", HERE),
        ("/platoon", {"ROS_DOMAIN_ID": "8"}),
        ("/platoon", {}),
        ("/platoon", {**HERE, "ROS_DISCOVERY_SERVER": "localhost:11811"}),
    ],
)
def test_another_name_or_domain_is_free(prefix: str, environment: dict[str, str]) -> None:
    first, other = PlatoonLock("/platoon", HERE), PlatoonLock(prefix, environment)
    assert first.taken_by() == ""
    assert other.taken_by() == ""
    first.drop()
    other.drop()


def test_a_link_that_somebody_else_laid_is_not_followed(folder: Path) -> None:
    lock = PlatoonLock("/platoon", HERE)
    assert lock.taken_by() == ""
    (file,) = folder.glob("*/platoon-*")
    lock.drop()
    file.unlink()
    precious = folder / "precious"
    precious.write_text("precious")
    file.symlink_to(precious)
    assert lock.taken_by() == "", "the graph alone has to tell"
    assert precious.read_text() == "precious"
