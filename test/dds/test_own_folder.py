"""The folder that others may not touch: where it is, and what is not taken for it."""

import os
import stat
from pathlib import Path

import pytest

from cacc_platoon.dds.own_folder import (
    folders_of_the_dead,
    own_folders,
    process_folder,
    unusable_folder,
)


@pytest.fixture
def base(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's runtime folder, and a cache that there is not."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("pwd.getpwuid", lambda _: (_ for _ in ()).throw(KeyError))
    (tmp_path / "runtime").mkdir()
    (tmp_path / "cache").write_text("no folder")
    return tmp_path / "runtime"


def of_another_user(path: Path) -> Path:
    """Return a folder that belongs to somebody else."""
    if os.getuid():
        return Path("/")
    path.mkdir()
    os.chown(path, 12345, 12345)
    return path


def test_it_is_in_the_runtime_folder_and_closed(base: Path) -> None:
    first, *others = own_folders()
    assert first == base / "cacc_platoon"
    assert others == []
    assert stat.S_IMODE(first.stat().st_mode) == 0o700
    assert unusable_folder() == ""


def test_without_a_runtime_folder_it_is_in_the_cache(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(base / "new" / "cache"))
    assert own_folders() == [base / "new" / "cache" / "cacc_platoon"]
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(base / "home"))
    assert own_folders() == [base / "home" / ".cache" / "cacc_platoon"]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.write_text(""), "is no folder"),
        (lambda path: path.symlink_to(path.parents[1]), "is no folder"),
        (lambda path: path.symlink_to("nowhere"), "is no folder"),
        (os.mkfifo, "is no folder"),
        (lambda path: (path.mkdir(), path.chmod(0o777)), "is open to others (mode 777)"),
        (lambda path: (path.mkdir(), path.chmod(0o750)), "is open to others (mode 750)"),
    ],
)
def test_what_somebody_may_have_prepared_is_not_taken(base, make, words) -> None:
    make(base / "cacc_platoon")
    assert own_folders() == []
    line = unusable_folder()
    assert f"{base / 'cacc_platoon'}: {words}" in line
    assert "XDG_CACHE_HOME" in line
    assert "\n" not in line
    assert process_folder() is None
    assert list(folders_of_the_dead()) == []


def test_nothing_is_made_in_the_home_of_another_user(
    base: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = of_another_user(base / "other")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(other))
    assert own_folders() == []
    assert f"{other} belongs to another user" in unusable_folder()
    assert not (other / "cacc_platoon").exists()


@pytest.mark.parametrize("name", ["x" * 300, "file/below"])
def test_where_no_folder_can_be_is_one_line(
    base: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (base / "file").write_text("")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(base / name / "run"))
    assert own_folders() == []
    assert "cannot be used (" in unusable_folder()


def test_no_home_at_all_is_one_line(base: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name)
    assert own_folders() == []
    assert unusable_folder().startswith("neither XDG_RUNTIME_DIR nor")


def test_only_the_dead_of_this_machine_are_found(base: Path) -> None:
    own = process_folder()
    assert own is not None
    place, pid, _ = own.name.split("-")
    dead = own.with_name(f"{place}-{pid}-1")
    for path in (own, dead, own.with_name(f"ffffffff-{pid}-1"), own.with_name(f"{place}-x-1")):
        path.mkdir()
    own.with_name(f"{place}-1-0").symlink_to(base)
    own.with_name(f"{place}-2-0").write_text("")
    assert list(folders_of_the_dead()) == [dead]
