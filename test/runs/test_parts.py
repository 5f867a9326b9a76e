"""Parts on a disk that is full."""

import resource
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from cacc_platoon.runs.parts import PartWriter, read_parts
from cacc_platoon.scenario import Scenario
from msg_adapters.topics import Graph

POSE = Graph.of(Scenario()).vehicles[1].pose
ROW = POSE.codec.encode(0, 1.0)


@contextmanager
def no_file_beyond(size: int) -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_what_is_written_in_part_is_an_error_and_not_read(tmp_path: Path) -> None:
    with closing(PartWriter(tmp_path / "part", [POSE], buffered=False)) as part:
        write = part.writers[POSE.name]
        write(ROW)
        with no_file_beyond(2 * len(ROW) - 1), pytest.raises(OSError, match="No space left"):
            write(ROW)
    assert len(read_parts([tmp_path / "part"])[POSE.name].messages) == 1
