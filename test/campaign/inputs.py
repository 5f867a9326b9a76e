"""Hostile scenario texts, bags and run folders: test/campaign/inputs.py --seed 1 --count 500.

No traceback, no hang, no memory above 1 GiB, only the documented exit codes, and on standard error
a few lines that can be shown.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import sqlite3
import struct
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import lz4.frame
from frame import Case, run_platoon, search  # type: ignore[import-not-found]
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from cacc_platoon.scenario.table import TABLE

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

VALUES = (
    "!!int abc", "!!float", "!!bool x", "!!timestamp x", "!!binary '*'", "!!set {a}", "!!str 1",
    "2020-13-45", "2020-02-30T25:00:00Z", "0b2", "0x" + "f" * 90, "9" * 309, "9" * 5000, "1e308",
    "-1e308", "1e999", ".nan", "-.inf", "null", "true", "[]", "{}", "''", "-0.0", "1e-320", "2e9",
    '"\\U99999999"', '"\\ud800"', '"\\0"', '"\\x1b[31m"', '"a\\nb\\nc"', "'" + "x" * 100_000 + "'",
    "[" + "1, " * 30_000 + "1]", "[" * 60 + "]" * 60, "[" * 20_000, "{a: " * 30 + "1" + "}" * 30,
    "&a [*a]", "*b", "/dev/zero", "/dev/full", "../../../etc/passwd", "/" + "d/" * 3000,
    "'%s%n{0}'", "\u202e\u2066", "\N{PILE OF POO}", "|\n  text", "module:Class", "os:system",
    "<<: 1", "[1, [2]]", "[a, b]", "vehicle_1", "1:2:3", "1_000", "~", "=", "!x y", "? a",
    "123456789012345678901",
)  # fmt: skip
KEYS = (
    "/**", "/*", "/platoon/vehicle_1/*", "/platoon/**", "/**/**/**/vehicle_2/*", "/" + "**/" * 20,
    "\x7f", "ros__parameters", "/platoon/vehicle_" + "9" * 5000, "/a b", "\u202e", "/" + "a/" * 300,
    "/platoon/vehicle_3/vehicle", "", "[1]", "~", "a: b", "x" * 100_000,
)  # fmt: skip
SHORT = ("--set", "run.duration=0.5", "--set", "run.step=0.1", "--set", "platoon.followers=2")


def scenario_text(rng: random.Random) -> str:
    """Return a scenario that is wrong in one or several ways, or right."""
    structure = rng.choice((_parameters, _parameters, _parameters, _sections, _bomb, _bulk, _bytes))
    head = rng.choice(("", "", "# Scenario \x1b[2J/../x\n", "# cacc_platoon scenario, format 9\n"))
    return head + structure(rng)


def _parameters(rng: random.Random) -> str:
    lines = ["/**:", "  ros__parameters:"]
    for name in rng.sample(sorted(TABLE), rng.randint(1, 6)):
        usual = json.dumps(TABLE[name].default)
        lines.append(f"    {name}: {rng.choice((rng.choice(VALUES), usual))}")
    return "\n".join(lines) + "\n"


def _sections(rng: random.Random) -> str:
    lines = ["/**:\n  ros__parameters: {platoon: {namespace: /" + "a/" * rng.randint(0, 70) + "a}}"]
    for key in rng.choices(KEYS, k=rng.choice((1, 3, 300))):
        value = rng.choice(("{vehicle: {tau: 0.4}}", "{v2v.rho: 4}", "[]", rng.choice(VALUES)))
        lines.append(f"{json.dumps(key)}:\n  ros__parameters: {value}")
    return "\n".join(lines) + "\n"


def _bomb(rng: random.Random) -> str:
    width, height = rng.randint(2, 9), rng.randint(3, 40)
    kind = rng.choice(("[{}]", "{{{}}}", "{{<<: [{}]}}"))
    lines = ["/**:", "  ros__parameters:", "    a0: &a0 {x: 1}"]
    for level in range(1, height):
        used = ", ".join(
            f"k{i}: *a{level - 1}" if kind == "{{{}}}" else f"*a{level - 1}" for i in range(width)
        )
        lines.append(f"    a{level}: &a{level} {kind.format(used)}")
    return "\n".join(lines) + "\n"


def _bulk(rng: random.Random) -> str:
    size = rng.choice((10_000, 100_000, 9_000_000))
    version = rng.choice(("", "%YAML 1.1\n---\n"))
    shape = rng.choice(("# {}\n", "a: '{}'\n", "{}: 1\n", "a: &{} 1\n", "a: !{} 1\n", 'a: "{}"\n'))
    unit = rng.choice(("x", "\\x1b", "é", "1,", "- ", "[", "\n", "#\n", "'", "*", " "))
    return version + shape.format(unit * (size // len(unit.encode())))


def _bytes(rng: random.Random) -> str:
    data = bytearray(_parameters(rng).encode())
    for _ in range(rng.choice((1, 5, 50))):
        data[rng.randrange(len(data))] = rng.randrange(256)
    return data.decode("latin-1")


def scenarios(rng: random.Random, folder: Path) -> Case:
    """Make a hostile scenario and read it, run it in arrays or set values of it."""
    file = folder / "scenario.yaml"
    text = scenario_text(rng)
    file.write_bytes(text.encode(rng.choice(("utf-8", "utf-8", "utf-16")), "surrogatepass"))
    setting = f"{rng.choice(sorted(TABLE))}={rng.choice(VALUES)}".replace("\0", "")[:100_000]
    match rng.randrange(4):
        case 0:
            return Case(text[:80], ["layout", str(file), "-o", "out", "--set", setting])
        case 1:
            return Case(text[:80], ["simulate", str(file), "-o", "out", *SHORT])
        case 2:
            file.write_text("/**:\n  ros__parameters: {}\n")
            return Case(
                setting[:80], ["simulate", str(file), "-o", "out", *SHORT, "--set", setting]
            )
    return Case(text[:80], ["layout", str(file), "-o", "out"])


@cache
def source() -> Path:
    """Return a folder with a sound run, and its bag as other tools would have written it."""
    import atexit
    import tempfile

    folder = Path(tempfile.mkdtemp(prefix="cacc_platoon_campaign_"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    (folder / "s.yaml").write_text("/**:\n  ros__parameters: {}\n")
    code, errors, _ = run_platoon(["simulate", "s.yaml", "-o", "run", *SHORT], folder)
    assert code == 0, errors
    for plugin in StoragePlugin:
        for mode in CompressionMode:
            if mode is not CompressionMode.STORAGE or plugin is StoragePlugin.MCAP:
                _copy(folder / "run" / "bag", folder / f"{plugin.name}_{mode.name}", plugin, mode)
    return folder


def _copy(bag: Path, target: Path, plugin: StoragePlugin, mode: CompressionMode) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(target, version=9, storage_plugin=plugin)
    if mode is not CompressionMode.NONE:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with Reader(bag) as reader, writer:
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=store)
            for c in reader.connections
        }
        for connection, time, data in reader.messages():
            writer.write(connections[connection.id], time, data)


def folders(rng: random.Random, folder: Path) -> Case:
    """Make a bag or a run folder that is damaged or forged, and report on it."""
    change = rng.choice(CHANGES)
    path = folder / "given"
    kind = rng.choice([path.name for path in source().iterdir() if path.is_dir()])
    shutil.copytree(source() / kind, path)
    change(rng, path)
    verb = rng.choice((["report"], ["report"], ["layout"]))
    return Case(f"{change.__name__} of {kind}", [*verb, str(path), "-o", "out"])


def _files(path: Path, *endings: str) -> list[Path]:
    return sorted(
        file for file in path.rglob("*") if file.is_file() and file.name.endswith(endings)
    )


def damaged_file(rng: random.Random, path: Path) -> None:
    """Change bytes of any file."""
    file = rng.choice(_files(path, ""))
    data = bytearray(file.read_bytes())
    match rng.randrange(4):
        case 0:
            del data[rng.randrange(len(data) + 1) :]
        case 1:
            at = rng.randrange(len(data) + 1)
            data[at:at] = rng.randbytes(rng.choice((1, 100, 10_000)))
        case _:
            for _ in range(rng.choice((1, 10, 1000)) if data else 0):
                data[rng.randrange(len(data))] = rng.randrange(256)
    file.write_bytes(data)


def another_kind_of_file(rng: random.Random, path: Path) -> None:
    """Put something else where a file was."""
    file = rng.choice(_files(path, ""))
    file.unlink()
    match rng.randrange(5):
        case 0:
            os.mkfifo(file)
        case 1:
            file.symlink_to(rng.choice(("/dev/zero", "/dev/null", "/proc/self/mem", file)))
        case 2:
            file.mkdir()
        case 3:
            file.write_bytes(b"")


def forged_metadata(rng: random.Random, path: Path) -> None:
    """Write another metadata.yaml."""
    for file in _files(path, "metadata.yaml")[:1]:
        text = file.read_text()
        match rng.randrange(4):
            case 0:
                text = scenario_text(rng)
            case 1:
                text += "# " + "x" * rng.choice((1000, 9_000_000)) + "\n"
            case 2:
                bomb = "".join(
                    f"    k{i}: &k{i} [{f'*k{i - 1}, ' * 9 if i else 1}]\n" for i in range(12)
                )
                text = f"rosbag2_bagfile_information:\n  custom_data:\n{bomb}"
            case 3:
                names = ["../" * 50, "x" * 5000, "a\\0b", "\\e[2J"]
                listed = "".join(
                    f'    - "{name}"\n' for name in rng.choices(names, k=rng.choice((1, 2000)))
                )
                text = f"rosbag2_bagfile_information:\n  relative_file_paths:\n{listed}"
        file.write_bytes(text.encode("utf-8", "replace"))


def forged_json(rng: random.Random, path: Path) -> None:
    """Write another run.json, or values of other types into it."""
    file = path / "run.json"
    document: Any = json.loads(file.read_text()) if file.is_file() else {}
    strange: tuple[Any, ...] = (
        None, True, -1, 1e308, float("nan"), float("inf"), 10**400, "x" * 300_000, "\x1b[2J\n", [],
        {}, [[]], {"a": []}, "\ud800", 2**64, "finished",
    )  # fmt: skip
    for key in rng.sample(sorted(document), min(len(document), rng.randint(0, 4))):
        document[key] = rng.choice(strange)
    text = json.dumps(document)
    if rng.random() < 0.3:
        text = rng.choice(
            ("[" * 100_000, "{" * 9, "1" * 5000, '{"a":' * 5000, "null", " " * 9_000_000)
        )
    file.write_text(text)


def left_parts(rng: random.Random, path: Path) -> None:
    """Leave what a killed supervisor leaves, with an index that is damaged or forged."""
    shutil.rmtree(path / "bag", ignore_errors=True)
    part = path / "parts" / "host_0"
    part.mkdir(parents=True)
    names = ("0000.cdr", "../../run.json", "/etc/passwd", "a\0b", "x" * 5000, 3, None)
    entry = {
        "name": rng.choice(("/platoon/vehicle_0/pose", "\x1b", 1)),
        "type": rng.choice(("geometry_msgs/msg/PoseStamped", None)),
        "size": rng.choice((104, 0, -1, 1e308, 2**70, "1", True)),
        "file": rng.choice(names),
    }
    document = rng.choice(([entry], {"format": 1, "topics": [entry]}, {"format": 1}, [1], None))
    text = rng.choice((json.dumps(document), "[" * 100_000, "", "\xff", '{"format": 1e400}'))
    (part / "topics.json").write_text(text, "latin-1")
    (part / "0000.cdr").write_bytes(rng.randbytes(1040))


def forged_scenario(rng: random.Random, path: Path) -> None:
    """Write another scenario.yaml, and take the bag's own away."""
    for file in _files(path, "metadata.yaml"):
        file.unlink()
    (path / "scenario.yaml").write_bytes(scenario_text(rng).encode("utf-8", "replace"))


def _record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


def compressed_bomb(rng: random.Random, path: Path) -> None:
    """Write an MCAP file, or a compressed one, that unpacks to much more than it is."""
    for file in _files(path, ".mcap", ".db3", ".zstd"):
        file.unlink()
    size = rng.choice((2**20, 2**26, 2**28))
    plain = rng.choice((bytes(9), b"\xff", _record(5, bytes(22)))) * (size // 20)
    pack: Callable[[bytes], bytes] = rng.choice((zstd.compress, lz4.frame.compress))
    name, packed = (b"lz4" if pack is lz4.frame.compress else b"zstd"), pack(plain)
    declared = rng.choice((len(plain), 0, 100, 2**63))
    head = struct.pack("<QQQII", 0, 0, declared, 0, len(name)) + name
    chunk = _record(6, head + struct.pack("<Q", len(packed)) + packed)
    bomb = b"\x89MCAP0\r\n" + chunk * rng.choice((1, 3, 20))
    if rng.random() < 0.3:
        (path / "bomb.mcap.zstd").write_bytes(
            zstd.compress(b"\x89MCAP0\r\n" + plain) * rng.choice((1, 5))
        )
    else:
        (path / "bomb.mcap").write_bytes(bomb[:9_000_000])


def forged_database(rng: random.Random, path: Path) -> None:
    """Write a database whose messages are computed, or of other types."""
    for file in _files(path, ".mcap", ".db3", ".zstd"):
        file.unlink()
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id"
    with sqlite3.connect(path / "forged.db3") as database:
        database.execute("CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        database.execute("INSERT INTO topics VALUES (1, ?, 'x')", ("/\x1b[2J/vehicle_1/pose",))
        database.execute(
            rng.choice(
                (
                    f"CREATE VIEW messages AS {endless}, 1 AS topic_id, 1 AS timestamp, "
                    "zeroblob(1000000) AS data FROM n",
                    "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, "
                    "data BLOB AS (zeroblob(500000000)))",
                    "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id, timestamp, data)",
                    "CREATE TABLE messages (id, topic_id, timestamp)",
                )
            )
        )
        if rng.random() < 0.7:
            kind = database.execute("SELECT type FROM sqlite_master WHERE name = 'messages'")
            if kind.fetchone() == ("table",):
                database.execute(
                    "INSERT INTO messages (id, topic_id, timestamp) VALUES (1, 1, 'x')"
                )
    database.close()


CHANGES = (
    damaged_file,
    damaged_file,
    another_kind_of_file,
    forged_metadata,
    forged_json,
    left_parts,
    forged_scenario,
    compressed_bomb,
    forged_database,
)

if __name__ == "__main__":
    sys.exit(search((scenarios, folders), __doc__ or ""))
