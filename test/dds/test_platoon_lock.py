"""The name of a platoon in a domain: one process of this user holds it, and only while it lives."""

import os
import subprocess
import sys

import pytest

from cacc_platoon.dds.platoon_lock import PlatoonLock

HOLD = (
    "import sys; from cacc_platoon.dds.platoon_lock import PlatoonLock; "
    "lock = PlatoonLock('/platoon', {'ROS_DOMAIN_ID': '1007'}); "
    "print(lock.taken_by() or 'held', flush=True); sys.stdin.read()"
)
HERE = {"ROS_DOMAIN_ID": "1007"}


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
        ("/platoon", {"ROS_DOMAIN_ID": "1008"}),
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


def test_a_name_that_another_user_holds_does_not_keep_a_run_away(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Whoever took a name of this user, which anybody can, is told by the kernel's word."""
    first, second = PlatoonLock("/platoon", HERE), PlatoonLock("/platoon", HERE)
    assert first.taken_by() == ""
    assert second.taken_by()
    user = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: user + 1)
    assert second.taken_by() == "", "the graph alone has to tell"
    first.drop()
