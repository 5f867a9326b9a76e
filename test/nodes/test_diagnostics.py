"""What a vehicle by a clock says on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message

from cacc_platoon.nodes.diagnostics import ClockDiagnostics


def test_each_message_is_of_the_samples_since_the_last_one() -> None:
    said = ClockDiagnostics("/platoon/vehicle_3", 0.01, 0.005)
    for k, (age, late) in enumerate([(0, 0.02), (1, 2.5), (4, 1.0), (0, 0.3)]):
        said.take_timing(k * 10_000_000, float(age), late)
        said.take_count(0, 3 * k)
        said.take_count(1, k)
    message = said.message(7, 8)
    (status,) = deserialize_message(serialize_message(message), type(message)).status
    assert (status.level, status.name) == (DiagnosticStatus.WARN, "/platoon/vehicle_3: clock")
    assert status.message == "2 of 4 samples a period late, or more"
    assert {pair.key: pair.value for pair in status.values} == {
        "samples": "4",
        "largest lateness [s]": "0.012500",
        "samples a period late or more": "2",
        "oldest pose used [s]": "0.04",
        "packets used": "12",
    }
    (status,) = said.message(8, 8).status
    assert (status.level, status.message) == (DiagnosticStatus.STALE, "no sample was taken")


def test_what_is_in_time_is_well() -> None:
    said = ClockDiagnostics("/platoon/vehicle_3", 0.01, 0.01)
    said.take_timing(0, 0.0, 0.1)
    found = said.summary()
    assert (found.level, found.message) == (DiagnosticStatus.OK, "in time")
