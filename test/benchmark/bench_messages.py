"""What raw CDR bytes and a scan of our own are worth on this machine.

    python test/benchmark/bench_messages.py [--duration 50]

Prints the time to pack and unpack one AccelStamped, by our codec and by rclpy, and the time to
read all messages of a bag of case A, by our scan, by rosbags and by the mcap library; each the
best of some tries.
"""

import argparse
import tempfile
import time
import timeit
from collections.abc import Callable
from pathlib import Path

from geometry_msgs.msg import AccelStamped
from mcap.reader import make_reader
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader

from cacc_platoon.bags.read import read_bag
from cacc_platoon.bags.write import typestore
from cacc_platoon.runs.folder import RunFolder
from cacc_platoon.runs.info import RunInfo
from cacc_platoon.runs.recording import recording_of
from cacc_platoon.scenario.file import load_scenario
from cacc_platoon.simulation import simulate
from msg_adapters.stamped import ACCEL, StampedCodec

PAPER_A = Path(__file__).parents[2] / "config" / "paper_a.yaml"
FRAME = "vehicle_1/base_link"
NUMBER, TRIES = 10_000, 5


def serialised() -> bytes:
    message = AccelStamped()
    message.header.stamp.nanosec = 20_000_000
    message.header.frame_id = FRAME
    message.accel.linear.x = 0.5
    data: bytes = serialize_message(message)
    return data


def time_messages() -> dict[str, float]:
    """Return the time for one message [us]."""
    codec = StampedCodec(ACCEL, FRAME)
    data = codec.encode(20_000_000, 0.5)
    calls: dict[str, Callable[[], object]] = {
        "our codec, to bytes": lambda: codec.encode(20_000_000, 0.5),
        "rclpy, to bytes": serialised,
        "our codec, from bytes": lambda: codec.decode(data),
        "rclpy, from bytes": lambda: deserialize_message(data, AccelStamped),
    }
    return {
        name: min(timeit.repeat(call, number=NUMBER, repeat=TRIES)) / NUMBER * 1e6
        for name, call in calls.items()
    }


def by_our_scan(bag: Path) -> None:
    """Find every message and take its stamp out."""
    for parts in read_bag(bag).topics.values():
        for topic in parts:
            topic.gather(4, 8)


def by_rosbags(bag: Path) -> None:
    """Get the bytes of every message."""
    with Reader(bag) as reader:
        for _ in reader.messages():
            pass


def decoded_by_rosbags(bag: Path) -> None:
    """Get every message as an object."""
    with Reader(bag) as reader:
        for connection, _, data in reader.messages():
            typestore().deserialize_cdr(data, connection.msgtype)


def by_mcap(bag: Path) -> None:
    """Get the bytes of every message."""
    with next(bag.glob("*.mcap")).open("rb") as file:
        for _ in make_reader(file).iter_messages():
            pass


def time_readers(duration: float) -> dict[str, float]:
    """Return the time to read a bag of so many simulated seconds [s]."""
    scenario = load_scenario(PAPER_A, [f"run.duration={duration}"])
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        run = RunFolder.create(Path(folder) / "run", scenario)
        run.finish(scenario, recording_of(simulate(scenario)), RunInfo())
        for reader in (by_our_scan, by_rosbags, decoded_by_rosbags, by_mcap):
            times = []
            for _ in range(TRIES):
                began = time.perf_counter()
                reader(run.bag)
                times.append(time.perf_counter() - began)
            found[reader.__name__.replace("_", " ")] = min(times)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--duration", type=float, default=50.0, help="simulated time [s]")
    options = parser.parse_args()
    for name, value in time_messages().items():
        print(f"{name:24} {value:8.2f} us")
    for name, value in time_readers(options.duration).items():
        print(f"{name:24} {value:8.2f} s")


if __name__ == "__main__":
    main()
