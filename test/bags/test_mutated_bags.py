"""50 damaged bags: each ends in a report or in one clear line, and in little time."""

import random
import shutil
import time

import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from cacc_platoon.analysis import analyse
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.cli import main
from cacc_platoon.errors import UserError
from cacc_platoon.report import metrics_document, report_run, summary

BAGS = 50
PATIENCE = 5.0  # s


def flip(data, rng):
    for _ in range(rng.choice([1, 10, 1000])):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def damage_head(data, rng):
    data[rng.randrange(min(len(data), 6000))] = rng.randrange(256)


def cut(data, rng):
    del data[rng.choice([0, 4, 50, rng.randrange(len(data))]) :]


def insert(data, rng):
    at = rng.randrange(len(data))
    data[at:at] = rng.randbytes(rng.randrange(1, 300))


def blank(data, rng):
    at = rng.randrange(len(data))
    data[at : at + 5000] = bytes(len(data[at : at + 5000]))


def exchange(data, rng):
    one, two = rng.randrange(len(data) // 2), len(data) // 2 + rng.randrange(len(data) // 4)
    data[one : one + 500], data[two : two + 500] = data[two : two + 500], data[one : one + 500]


MUTATIONS = (flip, damage_head, cut, insert, blank, exchange)


@pytest.fixture(scope="module")
def sources(bags, tmp_path_factory, scenario, recording):
    folder = tmp_path_factory.mktemp("sources")
    records = list(recording.values())
    shuffled = dict(zip(recording, [*records[1:], records[0]], strict=True))
    short = {
        name: TopicRows("std_msgs/msg/String", r.messages[:, :9]) for name, r in recording.items()
    }
    return [
        bags.bag(folder / "ours", scenario, recording),
        bags.foreign(folder / "sqlite", scenario, recording),
        bags.foreign(
            folder / "chunks",
            scenario,
            recording,
            StoragePlugin.MCAP,
            compression=CompressionMode.STORAGE,
        ),
        bags.foreign(folder / "zstd", scenario, recording, compression=CompressionMode.MESSAGE),
        bags.bag(folder / "wrong_types", scenario, shuffled),
        bags.bag(folder / "other_messages", scenario, short),
        bags.bag(folder / "renamed", scenario, {f"{n}_": r for n, r in recording.items()}),
    ]


def mutated(number, sources, folder):
    rng = random.Random(number)
    bag = shutil.copytree(sources[number % len(sources)], folder / f"bag_{number}")
    file = next(path for path in bag.iterdir() if path.suffix in (".mcap", ".db3"))
    match rng.randrange(10):
        case 0:
            (bag / "metadata.yaml").unlink()
        case 1:
            text = bytearray((bag / "metadata.yaml").read_bytes())
            for _ in range(20):
                text[rng.randrange(len(text))] = rng.randrange(256)
            (bag / "metadata.yaml").write_bytes(text)
        case 2:
            file.unlink()
        case _:
            data = bytearray(file.read_bytes())
            rng.choice(MUTATIONS)(data, rng)
            file.write_bytes(data)
    return bag


def test_mutated_bags(sources, tmp_path):
    outcomes = {"reported": 0, "refused": 0}
    for number in range(BAGS):
        bag = mutated(number, sources, tmp_path)
        begun = time.monotonic()
        try:
            report = analyse(bag, runs=0)
        except UserError as error:
            lines = [str(error)]
            outcomes["refused"] += 1
        else:
            document = metrics_document(report)
            assert all(line.isprintable() for line in summary(report, document).splitlines())
            assert document["provenance"]["messages"] > 0
            lines = [*report.run.findings]
            outcomes["reported"] += 1
        assert time.monotonic() - begun < PATIENCE
        assert all(line.isprintable() and len(line) > 10 for line in lines), lines
        shutil.rmtree(bag)
    assert min(outcomes.values()) > 20, outcomes


@pytest.mark.parametrize("number", [0, 7])
def test_damage_can_be_drawn(sources, tmp_path, number):
    """Whatever can be read can also be drawn."""
    try:
        report_run(mutated(number, sources, tmp_path), runs=0, output=tmp_path / "out")
    except UserError:
        return
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_command_says_one_line(tmp_path, capsys):
    file = tmp_path / "broken.mcap"
    file.write_bytes(b"no bag at all, really")
    assert main(["report", str(file)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err == f"platoon: {file}: is not an MCAP file, it does not begin as one. Give a bag.\n"
