"""`pip install .` gives the `platoon` command, the packages and the shared files, nothing else."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def prefix(tmp_path_factory, copy_source):
    """Return a prefix into which a clean copy is installed, without the network."""
    folder = tmp_path_factory.mktemp("pip")
    copy_source(folder / "source")
    options = ["--no-index", "--no-deps", "--no-build-isolation", "--ignore-installed"]
    command = [sys.executable, "-m", "pip", "install", *options, "--prefix", str(folder / "prefix")]
    install = subprocess.run(
        [*command, str(folder / "source")], capture_output=True, text=True, timeout=120
    )
    assert install.returncode == 0, install.stdout + install.stderr
    return folder / "prefix"


def run_installed(prefix: Path, *command: str) -> subprocess.CompletedProcess[str]:
    [packages] = prefix.glob("lib/python3.*/site-packages")
    return subprocess.run(
        command,
        cwd=prefix,
        env={**os.environ, "PYTHONPATH": str(packages)},
        capture_output=True,
        text=True,
        timeout=120,
    )


def test_platoon_is_the_only_command(prefix):
    assert [path.name for path in (prefix / "bin").iterdir()] == ["platoon"]


def test_platoon_answers_help_and_version(prefix):
    answer = run_installed(prefix, str(prefix / "bin" / "platoon"), "--help")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.startswith("usage: platoon")
    answer = run_installed(prefix, str(prefix / "bin" / "platoon"), "--version")
    assert answer.stdout.split()[0] == "cacc_platoon"


def test_the_installed_package_is_the_one_that_runs(prefix):
    script = (
        "import cacc_platoon, msg_adapters; print(cacc_platoon.__file__, msg_adapters.__file__)"
    )
    answer = run_installed(prefix, sys.executable, "-c", script)
    assert [Path(p).is_relative_to(prefix) for p in answer.stdout.split()] == [True, True]


def test_every_file_is_installed(prefix):
    [installed] = prefix.glob("lib/python3.*/site-packages")
    for package in ("cacc_platoon", "msg_adapters"):
        source = {p.relative_to(ROOT) for p in (ROOT / package).rglob("*") if kept(p)}
        assert source == {
            p.relative_to(installed) for p in (installed / package).rglob("*") if kept(p)
        }
    share = prefix / "share" / "cacc_platoon"
    names = {path.relative_to(share).as_posix() for path in share.rglob("*") if kept(path)}
    assert names == {
        "package.xml",
        "launch/platoon.launch.py",
        "launch/platoon_hosts.launch.py",
        *(p.relative_to(ROOT).as_posix() for p in (ROOT / "config").rglob("*.yaml")),
    }


def kept(path: Path) -> bool:
    return path.is_file() and path.suffix != ".pyc"
