"""Every planted fault is found and named in one line, and no other is."""

import json
import shutil

import numpy as np
import pytest

from cacc_platoon.analysis import analyse
from cacc_platoon.bags.raw import BagError
from cacc_platoon.bags.rows import TopicRows
from cacc_platoon.report import metrics_document
from cacc_platoon.runs.locate import locate
from cacc_platoon.runs.recorded_run import read_run
from msg_adapters.topics import VehicleTopics

SECOND = VehicleTopics("/platoon", 2)
POSE = SECOND.pose.name


def order(*samples):
    return lambda rows: rows[list(samples)]


@pytest.mark.parametrize(
    ("edit", "finding"),
    [
        (lambda rows: np.delete(rows, 150, axis=0), "gap: sample 150 (1.5 s) is missing"),
        (
            lambda rows: np.delete(rows, [150, 151], axis=0),
            "gap: sample 150 (1.5 s) to sample 151 (1.51 s) are missing",
        ),
        (
            order(*range(150), 151, 150, *range(152, 301)),
            "out of order: sample 150 (1.5 s) stands after sample 151",
        ),
        (
            order(*range(151), *range(150, 301)),
            "duplicate: sample 150 (1.5 s) is there more than once",
        ),
        (lambda rows: rows[10:], "begins late: at sample 10 (0.1 s)"),
        (lambda rows: rows[:250], "ends early: at sample 249 (2.49 s)"),
        (lambda rows: rows[:, :60], "unreadable messages, left out: 301"),
    ],
)
def test_fault_of_one_topic(bags, tmp_path, recording, edit, finding):
    run = read_run(bags.bag(tmp_path / "bag", bags.scenario(), bags.edited(recording, POSE, edit)))
    assert f"{POSE}: {finding}" in run.findings
    extra = [line for line in run.findings if finding not in line]
    assert extra in ([], [f"{POSE}: no message"])


@pytest.mark.parametrize(("value", "word"), [(np.nan, "nan"), (np.inf, "inf")])
def test_not_finite(bags, tmp_path, recording, value, word):
    scenario = bags.scenario()

    def plant(values):
        values[150] = value
        return values

    bag = bags.bag(tmp_path / "bag", scenario, bags.rewritten(recording, SECOND.twist, plant))
    report = analyse(bag, runs=0)
    assert report.run.findings == (
        f"{SECOND.twist.name}: not finite: sample 150 (1.5 s) is {word}",
    )
    whole = analyse(bags.bag(tmp_path / "whole", scenario, recording), runs=0)
    assert np.isfinite(report.measured.max_abs_spacing_error).all()
    assert report.measured.max_abs_spacing_error[0] == whole.measured.max_abs_spacing_error[0]


def test_second_platoon_of_another_name(bags, tmp_path, scenario, recording):
    other = bags.record(bags.scenario({"platoon.namespace": "/other", "platoon.followers": 5}))
    bag = bags.bag(tmp_path / "bag", scenario, {**recording, **other})
    run = read_run(bag)
    assert run.findings == (
        "a second platoon, /other (6 vehicles, 6923 messages), is in the bag and left out; "
        "--namespace chooses it",
    )
    assert run.trajectory.scenario.platoon.namespace == "/platoon"
    with pytest.raises(BagError, match=r"no platoon /third\. It has /other, /platoon"):
        read_run(bag, namespace="/third")


def test_second_platoon_of_the_same_name(bags, tmp_path, scenario, recording):
    """Another run recorded into the same topics: each stamp twice, with other values."""
    other = bags.record(bags.scenario({"run.seed": 9}))
    mixed = {
        name: TopicRows(
            record.type_name,
            np.stack([record.messages, other[name].messages], axis=1).reshape(
                -1, record.messages.shape[1]
            ),
        )
        for name, record in recording.items()
    }
    findings = read_run(bags.bag(tmp_path / "bag", scenario, mixed)).findings
    assert any("two publishers" in line and "second platoon" in line for line in findings)


def test_missing_topics(bags, tmp_path, scenario, recording):
    left = {n: r for n, r in recording.items() if n not in (POSE, SECOND.received.name)}
    report = analyse(bags.bag(tmp_path / "bag", scenario, left), runs=0)
    assert report.run.findings == (f"missing topics: {POSE}, {SECOND.received.name}",)
    peaks = metrics_document(report)["max_abs_spacing_error"]
    assert peaks[0] is not None
    assert peaks[1] is None  # its own position is missing
    assert peaks[2] is None  # its predecessor's is


def test_wrong_type(bags, tmp_path, scenario, recording):
    wrong = {**recording, POSE: recording[SECOND.accel.name]}
    findings = read_run(bags.bag(tmp_path / "bag", scenario, wrong)).findings
    assert findings == (
        f"{POSE}: is geometry_msgs/msg/AccelStamped, not geometry_msgs/msg/PoseStamped; left out",
    )


def test_what_several_topics_share_is_one_finding(bags, tmp_path, scenario, recording):
    accel = recording[SECOND.accel.name]
    wrong = {**recording, POSE: accel, VehicleTopics("/platoon", 3).pose.name: accel}
    short = bags.edited(wrong, SECOND.twist.name, lambda rows: rows[:-20])
    short = bags.edited(short, SECOND.accel.name, lambda rows: rows[:-20])
    findings = read_run(bags.bag(tmp_path / "bag", scenario, short)).findings
    assert findings == (
        f"2 topics ({POSE}, ...): are geometry_msgs/msg/AccelStamped, not "
        "geometry_msgs/msg/PoseStamped; left out",
        f"2 topics ({SECOND.twist.name}, ...): end early: at sample 280 (2.8 s)",
    )


def test_damaged_stamp_does_not_stretch_the_run(bags, tmp_path, scenario, recording):
    def late(rows):
        rows[150] = SECOND.pose.codec.encode_many([2**31 * 10**9 - 5], [0.0])[0]
        return rows

    run = read_run(bags.bag(tmp_path / "bag", scenario, bags.edited(recording, POSE, late)))
    assert run.grid.samples == 301
    assert any("stamps outside of the run, left out: 1" in line for line in run.findings)
    assert any("gap: sample 150" in line for line in run.findings)


@pytest.mark.parametrize(
    ("status", "message", "finding"),
    [
        ("failed", "no progress for 10 s", "the run failed: no progress for 10 s"),
        ("failed", "", "the run failed"),
        ("interrupted", "stopped by SIGINT", "the run was interrupted: stopped by SIGINT"),
    ],
)
def test_run_that_did_not_finish(run_folder, status, message, finding):
    file = run_folder / "run.json"
    info = {**json.loads(file.read_text()), "status": status, "message": message}
    file.write_text(json.dumps(info))
    assert read_run(*locate(run_folder)).findings == (finding,)


def test_altered_message_changes_the_digest(run_folder):
    """One bit of a coordinate flipped in the file: the digest tells, and so do the equations."""
    file = next((run_folder / "bag").glob("*.mcap"))
    content = bytearray(file.read_bytes())
    codec = SECOND.pose.codec
    position = read_run(run_folder / "bag").trajectory.position[150, 2]
    at = content.index(codec.encode(1_500_000_000, position))
    content[at + codec.size - 56] ^= 0x10  # x, its lowest byte
    file.write_bytes(content)
    report = analyse(run_folder, runs=0)
    assert any(line.startswith("the digest is") for line in report.run.findings)
    assert report.run.trajectory.position[150, 2] != position
    assert report.consistency.largest > 0.0


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("suffix", ["mcap", "db3"])
def test_truncated_file_is_read_as_far_as_it_goes(bags, tmp_path, recording, share, suffix):
    make = bags.bag if suffix == "mcap" else bags.foreign
    bag = make(tmp_path / "bag", bags.scenario(), recording)
    file = next(bag.glob(f"*.{suffix}"))
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
    run = read_run(bag)
    assert any("as far as it goes" in line for line in run.findings)
    assert 0.5 * share < run.messages / 4515 <= share + 0.1  # an index is a tenth of the file


@pytest.mark.parametrize(
    ("content", "message"),
    [(b"", "is empty"), (b"hello world, this is no bag", "is not an MCAP file")],
)
def test_no_bag(tmp_path, content, message):
    file = tmp_path / "bag.mcap"
    file.write_bytes(content)
    with pytest.raises(BagError, match=message):
        read_run(file)


def test_nothing_there(tmp_path):
    with pytest.raises(BagError, match="No such file"):
        analyse(tmp_path / "nowhere")
    with pytest.raises(BagError, match=r"holds no \.mcap or \.db3 file"):
        analyse(tmp_path)


def test_foreign_topics_only(bags, tmp_path, scenario, recording):
    left = {f"/robot{n.removeprefix('/platoon')}x": r for n, r in recording.items()}
    with pytest.raises(BagError, match=r"holds no platoon, only /platoon/scenario, /robot"):
        read_run(bags.bag(tmp_path / "bag", scenario, left))


def test_metadata_missing_or_damaged(bags, tmp_path, scenario, recording):
    bag = bags.bag(tmp_path / "bag", scenario, recording)
    (bag / "metadata.yaml").write_bytes(b"\xff\xfe{{{")
    assert read_run(bag).findings == (
        "metadata.yaml is damaged; the storage files were read without it",
    )
    shutil.copytree(bag, tmp_path / "other")
    (tmp_path / "other" / "metadata.yaml").unlink()
    assert read_run(tmp_path / "other").findings == (
        "metadata.yaml is missing; the storage files were read without it",
    )
