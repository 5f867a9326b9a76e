"""What a platoon looks like now: a record that a terminal, a page and scripts are given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cacc_platoon.formats import Format
from cacc_platoon.scenario.run_event import RunEvent

FORMAT = Format("watch --json", 1)
RUNNING, PAUSED = "running", "paused"
"""Phases of a run whose vehicles drive, and of one in lockstep that waits in the middle."""


@dataclass(frozen=True)
class VehicleNow:
    """What is known of one vehicle; None where nothing is.

    Attributes
    ----------
    index : int
        Its index.
    sample : int, optional
        The sample of what follows.
    position, velocity, acceleration : float, optional
        Its motion [m, m/s, m/s^2].
    gap, spacing_error : float, optional
        To the vehicle ahead, where that is known at the same sample [m].
    received : float, optional
        The acceleration in the packet that was delivered last [m/s^2].
    packet_age : float, optional
        How long ago that was sent [s].
    reception : str
        What the vehicle does about what it receives, where it can fall back; empty elsewhere.
    alarm : bool, optional
        Whether its monitor has an alarm, where it has a monitor.
    lateness : float, optional
        How late the sample was, by clocks [control periods].
    """

    index: int
    sample: int | None = None
    position: float | None = None
    velocity: float | None = None
    acceleration: float | None = None
    gap: float | None = None
    spacing_error: float | None = None
    received: float | None = None
    packet_age: float | None = None
    reception: str = ""
    alarm: bool | None = None
    lateness: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the object that `Picture.to_json` holds of it."""
        return {
            "vehicle": self.index,
            "sample": self.sample,
            "position": self.position,
            "velocity": self.velocity,
            "acceleration": self.acceleration,
            "gap": self.gap,
            "spacing_error": self.spacing_error,
            "received": self.received,
            "packet_age": self.packet_age,
            "reception": self.reception or None,
            "alarm": self.alarm,
            "lateness": self.lateness,
        }


@dataclass(frozen=True)
class Picture:
    """What a platoon looks like now.

    Attributes
    ----------
    namespace : str
        The platoon's.
    phase : str
        How far its run is: a phase of its status, or PAUSED; empty as long as nothing was heard.
    sample, samples : int
        Sample that was reached, -1 before the first, and how many there will be.
    step : float
        The control period [s].
    factor : float, optional
        How fast it goes, in simulated over wall time, while it runs.
    left : float, optional
        How long it still takes at this pace [s].
    silence : float
        For how long nothing was heard of it [s].
    message : str
        Why it has failed; empty otherwise.
    events : tuple of RunEvent
        What happened last, the newest at the end.
    vehicles : tuple of VehicleNow
        From front to rear; none as long as the scenario is not known.
    """

    namespace: str
    phase: str = ""
    sample: int = -1
    samples: int = 0
    step: float = 0.0
    factor: float | None = None
    left: float | None = None
    silence: float = 0.0
    message: str = ""
    events: tuple[RunEvent, ...] = ()
    vehicles: tuple[VehicleNow, ...] = ()

    @property
    def time(self) -> float:
        """Simulated time that was reached [s]."""
        return max(self.sample, 0) * self.step

    @property
    def seen(self) -> int:
        """The newest sample of a vehicle, -1 while there is none."""
        return max((one.sample for one in self.vehicles if one.sample is not None), default=-1)

    def to_json(self) -> dict[str, Any]:
        """Return the object that scripts and pages are given."""
        return {
            "format": FORMAT.version,
            "namespace": self.namespace,
            "phase": self.phase or None,
            "sample": self.sample,
            "samples": self.samples,
            "time": round(self.time, 9),
            "real_time_factor": self.factor,
            "left": self.left,
            "silence": self.silence,
            "message": self.message,
            "events": [
                {
                    "time": round(event.sample * self.step, 9),
                    "sample": event.sample,
                    "node": event.node,
                    "kind": event.kind,
                    "text": event.text,
                }
                for event in self.events
            ],
            "vehicles": [vehicle.to_json() for vehicle in self.vehicles],
        }
