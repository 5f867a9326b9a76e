"""The log of a run: a file for each process, and never a reason for a run to fail."""

import logging
from pathlib import Path

import pytest

from cacc_platoon.supervision import log


def test_what_is_logged_within_is_in_the_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "logs" / "host_0.log"
    log.LOG.info("before")
    with log.logging_to(path):
        log.LOG.info("within %d", 3)
    log.LOG.info("after")
    (line,) = path.read_text().splitlines()
    assert line.endswith(" MainProcess: within 3")


def test_two_runs_of_one_process_have_a_log_each(tmp_path: Path) -> None:
    for name in ("first", "second"):
        with log.logging_to(tmp_path / name):
            log.LOG.info("this is %s", name)
    assert [len((tmp_path / name).read_text().splitlines()) for name in ("first", "second")] == [
        1,
        1,
    ]


def test_a_log_that_cannot_be_opened_is_done_without(tmp_path: Path) -> None:
    (tmp_path / "logs").write_text("a file where a folder should be")
    with log.logging_to(tmp_path / "logs" / "host_0.log"):
        log.LOG.info("lost")


def test_a_full_disk_is_no_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    with log.logging_to(Path("/dev/full")):
        log.LOG.info("lost")
    assert capfd.readouterr().err == ""


def test_names_in_any_encoding_can_be_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log.LOG, "propagate", False)  # pytest reports what reaches the root
    with log.logging_to(tmp_path / "log"):
        log.LOG.info("\udce9")
    assert (tmp_path / "log").read_text().endswith("?\n")


def test_nothing_is_shown_unless_asked_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(log.LOG, "handlers", [*log.LOG.handlers])
    log.LOG.error("not shown")
    assert capsys.readouterr().err == ""
    assert not log.logs_to_stderr()
    for _ in range(2):
        log.log_to_stderr()
    assert log.logs_to_stderr()
    log.LOG.info("shown once")
    assert capsys.readouterr().err.count("shown once") == 1
    assert isinstance(log.LOG, logging.Logger)


def test_messages_are_forwarded_without_time_and_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log.LOG, "handlers", [*log.LOG.handlers])
    received: list[str] = []
    log.forward_log(received.append)
    log.LOG.info("host %s: %s", "vehicle_3_vehicle", "matched")
    assert received == ["host vehicle_3_vehicle: matched"]
