"""One fault, done to one real platoon: the process that `trials` starts for each."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cacc_platoon.analysis import analyse
from cacc_platoon.analysis.standing import DataState
from cacc_platoon.bags.digest import run_digest
from cacc_platoon.bags.raw import BagError
from cacc_platoon.campaign.check import Outcome
from cacc_platoon.campaign.deeds import Deed, loopback
from cacc_platoon.campaign.plan import LATE, LOCKSTEP, Fault, Moment, scenario_of
from cacc_platoon.campaign.trials import OUTCOME_FILE
from cacc_platoon.campaign.witness import LIMIT, Witness
from cacc_platoon.dds.environment import TRANSPORTS
from cacc_platoon.dds.shared_memory import sweep
from cacc_platoon.errors import UserError
from cacc_platoon.runs.info import EndStatus, InfoError, RunInfo
from cacc_platoon.runs.recorded_run import read_run
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from cacc_platoon.stop_signal import STOP_SIGNALS, ended_by
from cacc_platoon.testing import Platoon
from cacc_platoon.testing.leftovers import unowned_files
from msg_adapters.topics import Graph

TO_GO = 20.0
"""How long processes may take to go after the command [s]."""
TO_SWEEP = 10.0
"""How long shared memory may take to be as it was [s]."""
_DOUBT = re.compile(r"everything from sample (\d+) on may be wrong")


def try_fault(fault: Fault, scenario: Scenario, folder: Path) -> Outcome:
    """Run a platoon, let a fault happen to it, and return what came of it."""
    before = unowned_files()
    (folder / "tmp").mkdir()
    environment = {"TMPDIR": str(folder / "tmp"), "ROS_LOG_DIR": str(folder / "log")}
    if fault.needs_namespace:
        environment[TRANSPORTS] = "UDPv4"  # otherwise all goes through shared memory
    judges = fault.moment in LATE
    run = Platoon(
        scenario, hosts=fault.hosts, folder=folder, report=judges, environment=environment
    )
    with run:
        witness = Witness(run)
        deed = Deed(fault, witness, folder)
        outcome = _follow(run, witness, deed, fault)
    left = [f"tmp/{path.name}" for path in (folder / "tmp").iterdir()]
    left += _left_in_shared_memory(witness.segments, before)
    return dataclasses.replace(outcome, left=tuple(left))


def _follow(run: Platoon, witness: Witness, deed: Deed, fault: Fault) -> Outcome:
    """Let the fault happen, wait for all ends and look at what there is."""
    begun, broken, code = time.monotonic(), [], None
    try:
        witness.reach(fault)
        deed.do()
        code = run.result(LIMIT + fault.amount * (fault.kind != "flood")).exit_code
    except TimeoutError as error:
        broken.append(str(error))
    seconds = time.monotonic() - begun
    said = run.result(1.0) if code is not None else None
    broken += [line for other in deed.others if (line := _end_of(other, code))]
    with contextlib.suppress(TimeoutError):
        run.wait_gone(TO_GO)
    outcome = Outcome(
        seconds,
        code,
        said.errors if said else "",
        suspects=deed.suspects,
        late=deed.late,
        broken=tuple(broken),
        living=tuple(run.living()),
    )
    return _with_tracebacks(_with_folder(outcome, run, fault), run, said.output if said else "")


def _end_of(other: subprocess.Popen[str], first: int | None) -> str:
    """Return what is wrong with how a second platoon ended."""
    try:
        _, errors = other.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        other.kill()
        return "the second platoon did not end"
    if "Traceback" in errors:
        return f"a traceback of the second platoon: {errors[-400:]!r}"
    codes = {first, other.returncode}
    if codes != {0, 1}:
        return f"of two platoons one has to finish: exit codes {first} and {other.returncode}"
    return ""


def _with_folder(outcome: Outcome, run: Platoon, fault: Fault) -> Outcome:
    """Return the outcome with what the run folder says; `platoon report` finishes what is not."""
    folder = run.folder.path
    if not folder.is_dir():
        return outcome
    if not run.folder.bag.is_dir():
        outcome = _reported(outcome, run)
    try:
        info = RunInfo.read(folder)
    except (InfoError, UserError) as error:
        return dataclasses.replace(outcome, broken=(*outcome.broken, f"run.json: {error}"))
    if info is None:
        return outcome
    doubt = _DOUBT.search(info.message)
    outcome = dataclasses.replace(
        outcome,
        state=str(info.status),
        message=info.message,
        doubted_from=int(doubt[1]) if doubt else None,
    )
    return _with_data(outcome, run, info, fault)


def _reported(outcome: Outcome, run: Platoon) -> Outcome:
    """Let `platoon report` make the bag of a run whose command did not come to it."""
    command = [sys.executable, "-m", "cacc_platoon", "report", str(run.folder.path)]
    try:
        report = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=LIMIT,
            check=False,
            env=run.environment(),
        )
    except subprocess.TimeoutExpired:
        broken = (*outcome.broken, f"report did not end within {LIMIT:g} s")
        return dataclasses.replace(outcome, broken=broken)
    return dataclasses.replace(outcome, report_code=report.returncode, report_said=report.stderr)


def _with_data(outcome: Outcome, run: Platoon, info: RunInfo, fault: Fault) -> Outcome:
    """Return the outcome with what the bag holds."""
    finished = info.status is EndStatus.FINISHED
    if not run.folder.bag.is_dir():
        return dataclasses.replace(outcome, intact=False if finished else None)
    try:
        if fault.sync == LOCKSTEP:
            return _as_simulated(outcome, run, info)
        return _as_recorded(outcome, run)
    except BagError as error:
        if fault.kind == "deleted" or not (finished or info.samples):  # there is nothing to read
            return outcome
        return dataclasses.replace(outcome, broken=(*outcome.broken, f"the bag: {error}"))


def _as_simulated(outcome: Outcome, run: Platoon, info: RunInfo) -> Outcome:
    """Compare the bag of a run in lockstep with the simulation, to the last bit."""
    expected = simulate(run.scenario)
    recorded = read_run(run.folder.bag).trajectory
    samples = len(recorded.position)
    wrong = np.zeros(samples, bool)
    for name in ("position", "velocity", "acceleration"):
        found, wanted = getattr(recorded, name), getattr(expected, name)[:samples]
        wrong |= ((found != wanted) & np.isfinite(found)).any(axis=1)
    digest = run_digest(recording_of(expected), Graph.of(run.scenario))
    return dataclasses.replace(
        outcome,
        samples=samples,
        wrong_from=int(np.flatnonzero(wrong)[0]) if wrong.any() else None,
        intact=info.digest == digest and samples == run.scenario.samples,
        collided=info.status is EndStatus.FINISHED and bool((recorded.gap <= 0.0).any()),
    )


def _as_recorded(outcome: Outcome, run: Platoon) -> Outcome:
    """Work out a run by clocks again from what was recorded, to the last bit."""
    report = analyse(run.folder.path)
    largest = max(report.consistency.largest, report.recomputed.links.largest)
    return dataclasses.replace(
        outcome,
        samples=len(report.run.trajectory.position),
        intact=largest == 0.0 and report.standing.state is DataState.INTACT,
        collided=report.measured.first_collision is not None,
    )


def _with_tracebacks(outcome: Outcome, run: Platoon, output: str) -> Outcome:
    """Return the outcome with everything in which there is a traceback."""
    texts = {"the output": output, "the errors": outcome.said, "report": outcome.report_said}
    logs = run.folder.logs.glob("*") if run.folder.logs.is_dir() else ()
    texts |= {f"logs/{log.name}": log.read_text(errors="replace") for log in logs}
    found = tuple(
        f"{name}: {text[text.index('Traceback') :][-600:]!r}"
        for name, text in texts.items()
        if "Traceback" in text
    )
    return dataclasses.replace(outcome, tracebacks=found)


def _left_in_shared_memory(used: set[str], before: set[str]) -> list[str]:
    """Return what the platoon used and nobody removes, as the next of ours would."""
    deadline = time.monotonic() + TO_SWEEP
    while left := used & unowned_files(before):
        sweep()
        if time.monotonic() > deadline:
            break
        time.sleep(0.2)
    return sorted(left)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the fault that is given as JSON; write what came of it beside the run."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("fault", help="all of it, as JSON")
    parser.add_argument("folder", type=Path, help="where its files go")
    parser.add_argument("--scenario", type=Path, help="whose platoon it is")
    options = parser.parse_args(arguments)
    values = json.loads(options.fault)
    fault = Fault(**{**values, "moment": Moment(values["moment"])})
    given = load_scenario(options.scenario) if options.scenario else None
    if fault.needs_namespace:
        loopback(up=True)
    for number in STOP_SIGNALS:  # the platoon hears them, though nohup or a script ignores some
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    with ended_by(signal.SIGTERM, signal.SIGHUP):
        outcome = try_fault(fault, scenario_of(fault, given), options.folder)
    text = json.dumps(dataclasses.asdict(outcome))
    (options.folder / OUTCOME_FILE).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
