"""The parameter table: each field is one parameter with its unit, default, range and meaning.

ROS descriptors, scenario files, `--set`, the error lines and the README table are made from it.
"""

from __future__ import annotations

from dataclasses import dataclass

from cacc_platoon.scenario.parameter import Parameter, parameter, rows
from cacc_platoon.scenario.v2v_parameters import V2V


@dataclass(frozen=True)
class Platoon:
    """Who drives, and how they begin."""

    followers: int = parameter(
        12, "-", "the number of vehicles behind the leader", at_least=1, at_most=500
    )
    first_follower: int = parameter(
        1,
        "-",
        "the index of the first follower; the leader has the one before",
        at_least=1,
        at_most=500,
    )
    predecessors: int = parameter(
        1,
        "-",
        "the number of vehicles ahead that a follower receives from",
        at_least=1,
        at_most=500,
    )
    standstill_distance: float = parameter(5.0, "m", "the spacing d at rest", at_least=0.0)
    initial_speed: float = parameter(
        25.0, "m/s", "the speed in equilibrium at time 0", at_least=0.0
    )
    namespace: str = parameter("/platoon", "-", "the prefix of every topic and node name")


@dataclass(frozen=True)
class Vehicle:
    """The plant of a follower."""

    tau: float | tuple[float, ...] = parameter(
        0.5,
        "s",
        "the actuation lag tau, one value or one per follower",
        above=0.0,
        consequence="the plant would have no lag to integrate",
    )
    tau_max: float = parameter(
        0.5, "s", "tau0, the largest lag the design must tolerate", above=0.0, at_most=1e6
    )
    length: float = parameter(
        0.0,
        "m",
        "the length of the vehicle, which gaps and collisions count; 0 for a point, so that d and "
        "the gap include the vehicle ahead",
        at_least=0.0,
        at_most=1e3,
    )
    limits: str = parameter(
        "none",
        "-",
        "what the actuator can do: anything, the three values below, or those of ISO 15622 by "
        "speed (as secondary sources give them)",
        choices=("none", "constant", "iso15622"),
    )
    max_acceleration: float = parameter(
        2.5, "m/s^2", "the largest command, where limits are constant", above=0.0
    )
    max_deceleration: float = parameter(
        8.0, "m/s^2", "the largest negative command, where limits are constant", above=0.0
    )
    max_jerk: float = parameter(
        10.0, "m/s^3", "the largest change of the command, where limits are constant", above=0.0
    )
    stops: bool = parameter(False, "-", "whether the vehicle stands where it would drive backwards")


@dataclass(frozen=True)
class Sensing:
    """How a follower measures the vehicle ahead."""

    delay: float = parameter(
        0.0,
        "s",
        "how old range and range rate are, rounded up to control periods",
        at_least=0.0,
        at_most=10.0,
    )
    range_std: float = parameter(
        0.0, "m", "the standard deviation of the noise of the range", at_least=0.0
    )
    range_rate_std: float = parameter(
        0.0, "m/s", "the standard deviation of the noise of the range rate", at_least=0.0
    )


@dataclass(frozen=True)
class Controller:
    """The constant time headway policy."""

    time_headway: float = parameter(
        0.95,
        "s",
        "the time headway h_w",
        above=0.0,
        consequence="vehicles would close up as they speed up",
    )
    k_a: float = parameter(0.5, "-", "the gain on the received acceleration", at_least=0.0)
    k_v: float = parameter(0.63, "1/s", "the gain on the velocity error", at_least=0.0)
    k_p: float = parameter(
        0.009,
        "1/s^2",
        "the gain on the spacing error",
        above=0.0,
        consequence="spacing errors would never be corrected",
    )
    headway_rate: float = parameter(
        0.05, "s/s", "how fast the time headway changes where it is changed in a run", above=0.0
    )
    law: str = parameter(
        "", "-", "a custom control law, module:Class, in place of time headway and gains"
    )


@dataclass(frozen=True)
class Leader:
    """What vehicle 0 does."""

    profile: str = parameter(
        "sine",
        "-",
        "the leader's motion",
        choices=("sine", "step", "brake", "constant", "csv", "bag"),
    )
    start: float = parameter(10.0, "s", "the time the disturbance begins", at_least=0.0)
    amplitude: float = parameter(0.5, "m/s^2", "the peak acceleration of sine")
    angular_frequency: float = parameter(0.1, "rad/s", "the frequency of sine", above=0.0)
    acceleration: float = parameter(1.0, "m/s^2", "the acceleration of step")
    hold: float = parameter(5.0, "s", "how long step accelerates", above=0.0)
    deceleration: float = parameter(3.0, "m/s^2", "the deceleration of brake", above=0.0)
    final_speed: float = parameter(0.0, "m/s", "the speed at which brake ends", at_least=0.0)
    file: str = parameter(
        "", "-", "the table of time [s], speed [m/s] that csv reads; the run or bag of profile bag"
    )
    times: tuple[float, ...] = parameter((), "s", "the times of csv, read from file")
    speeds: tuple[float, ...] = parameter((), "m/s", "the speeds of csv, read from file")
    vehicle: int = parameter(
        -1, "-", "the vehicle of the bag that leads, -1 for its last one", at_least=-1
    )
    digest: str = parameter("", "-", "the digest of that vehicle's topics, filled in by the run")


@dataclass(frozen=True)
class Run:
    """How the run is carried out."""

    step: float = parameter(0.01, "s", "the control period T", above=0.0, at_most=1.0)
    duration: float = parameter(200.0, "s", "the simulated time", above=0.0)
    seed: int = parameter(1, "-", "the seed of all noise", at_least=0)
    sync: str = parameter(
        "lockstep",
        "-",
        "how nodes keep time: each sample as soon as its inputs are there, bit for bit the same "
        "in every run, or every vehicle by a clock of its own",
        choices=("lockstep", "wall"),
    )
    phases: str = parameter(
        "spread",
        "-",
        "how far the clocks of vehicles are behind a common start, where they have clocks: evenly "
        "spread over a control period from front to rear, or drawn at random by vehicle and seed",
        choices=("spread", "random"),
    )
    real_time_factor: float = parameter(
        0.0,
        "-",
        "the pace in simulated over wall time, 0 for as fast as possible or, by clocks, for 1",
        at_least=0.0,
        at_most=1e6,
    )
    hosts: int | str = parameter(
        "auto",
        "-",
        "the number of processes: auto (one per core), per_node or a number",
        at_least=1,
    )
    spawn: bool = parameter(True, "-", "whether the supervisor starts the hosts itself")
    manual_nodes: tuple[str, ...] = parameter(
        (), "-", "the manually started nodes, such as vehicle_3/vehicle"
    )
    remote_hosts: tuple[str, ...] = parameter(
        (),
        "-",
        "the hosts that `platoon host NAME` starts, on whichever machines, each with its vehicles "
        'such as "east=1-6" or "west=0,7-12"',
    )
    host_commands: tuple[str, ...] = parameter(
        (),
        "-",
        "the commands through which the supervisor starts such hosts, each "
        '"NAME=COMMAND" such as "east=ssh user@east"',
    )
    restarts: int = parameter(
        0,
        "-",
        "how often a process of this machine that ended is started again, by clocks "
        "(run.sync = wall)",
        at_least=0,
        at_most=1000,
    )
    window: int = parameter(
        64, "samples", "how far the leader may be ahead of the slowest", at_least=1, at_most=1000
    )
    start_timeout: float = parameter(
        30.0,
        "s",
        "how long the start may make no progress; in proportion more from 100 nodes on",
        above=0.0,
    )
    stall_timeout: float = parameter(
        10.0,
        "s",
        "how long no progress is taken for a pause; in proportion more from 100 nodes on",
        above=0.0,
    )
    timeline: tuple[str, ...] = parameter(
        (),
        "-",
        'changes in the course of the run, each "TIME TARGET KEY=VALUE" such as "20 link_3 '
        'v2v.loss=1" or "40 vehicle_5 controller.time_headway=1.2"',
    )
    adjustable: bool = parameter(
        False,
        "-",
        "whether ros2 param set may change v2v.loss of a noise_relay and controller.time_headway "
        "of a vehicle in the course of the run",
    )
    pause_at: float = parameter(
        -1.0,
        "s",
        "the simulated time at which the run pauses by itself, -1 for never; in lockstep",
        at_least=-1.0,
    )
    step_samples: int = parameter(
        1,
        "samples",
        "how far the service step lets a paused run go on; ros2 param set changes it in the run",
        at_least=1,
        at_most=1_000_000,
    )
    clock: bool = parameter(
        False,
        "-",
        "whether the supervisor publishes the simulated time on /clock, for use_sim_time",
    )
    stop_on_collision: bool = parameter(
        True,
        "-",
        "whether the run ends at the first sample at which two vehicles touch; by clocks it goes "
        "on, and an event says so",
    )

    @property
    def stride(self) -> int:
        """How many samples there are from one word of a recorder's progress to the next."""
        return max(1, self.window // 4)

    @property
    def clock_period(self) -> float:
        """How long a control period takes by clocks [s]."""
        return self.step / (self.real_time_factor or 1.0)


@dataclass(frozen=True)
class Record:
    """Where the run goes, and what it holds besides pose, twist, accel and v2v/accel."""

    directory: str = parameter("", "-", "the run folder, empty for runs/<scenario>-<UTC time>")
    parts: str = parameter(
        "", "-", "the folder below which manually started nodes record, with record:=DIR"
    )
    command: bool = parameter(False, "-", "whether vehicles publish u on command")
    spacing_error: bool = parameter(False, "-", "whether vehicles publish delta and e")


GROUPS: dict[str, type] = {
    "platoon": Platoon,
    "vehicle": Vehicle,
    "sensing": Sensing,
    "controller": Controller,
    "v2v": V2V,
    "leader": Leader,
    "run": Run,
    "record": Record,
}
PER_VEHICLE = ("vehicle", "sensing", "controller", "v2v")
TABLE: dict[str, Parameter] = {
    row.name: row
    for group, owner in GROUPS.items()
    for row in rows(group, owner, per_vehicle=group in PER_VEHICLE)
}
FORMER_NAMES = {"run.by_hand": "run.manual_nodes"}
"""Names that parameters had in earlier releases; scenario files with them are still read."""

SNR_DB = Parameter(
    "v2v.snr_db",
    "float",
    13.979,
    "dB",
    "the signal-to-noise ratio, instead of v2v.rho",
    above=0.0,
    at_most=300.0,
    consequence="the noise could reverse the sign of the acceleration, or would vanish",
)
