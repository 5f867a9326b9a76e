"""How DDS is set up: closed by default, opened by one variable, left to the user who has a say."""

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from cacc_platoon.dds import environment, shared_memory
from cacc_platoon.dds.environment import is_local, prefer_local, set_up
from cacc_platoon.dds.profile import LOOPBACK, LOOPBACK_MANY, LOOPBACK_UDP, OPEN
from cacc_platoon.errors import UserError

RANGE, TRANSPORTS = environment.RANGE, environment.TRANSPORTS
SKIP = environment.SKIP_WORKING_FOLDER
PROFILE = environment.PROFILE_VARIABLES[0]
NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


@pytest.mark.parametrize(
    "given", [{}, {RANGE: ""}, {RANGE: "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1", RANGE: "SUBNET"}]
)
def test_by_default_nodes_are_reached_on_this_machine_alone(given: dict[str, str]) -> None:
    made = dict(given)
    prefer_local(made)
    assert made == {RANGE: "SYSTEM_DEFAULT", PROFILE: str(LOOPBACK)}
    assert is_local(made)
    again = dict(made)
    prefer_local(again)
    assert again == made


def test_one_variable_opens_them() -> None:
    made = {RANGE: "SUBNET"}
    prefer_local(made)
    assert made == {RANGE: "SUBNET", PROFILE: str(OPEN)}
    assert not is_local(made)
    closed: dict[str, str] = {}
    prefer_local(closed)
    opened = {**closed, RANGE: "SUBNET"}
    prefer_local(opened)
    assert opened == made


@pytest.mark.parametrize(
    "given",
    [
        {PROFILE: "mine.xml"},
        {environment.PROFILE_VARIABLES[1]: "mine.xml"},
        {"ROS_DISCOVERY_SERVER": "10.0.0.1:11811"},
        {TRANSPORTS: "LARGE_DATA"},
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
    ],
)
def test_who_has_arranged_it_himself_keeps_that(given: dict[str, str]) -> None:
    made = dict(given)
    prefer_local(made)
    assert made == {**given, RANGE: "LOCALHOST"}


def test_without_shared_memory_it_is_udp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {TRANSPORTS: "UDPv4"}
    prefer_local(made)
    assert made[PROFILE] == str(LOOPBACK_UDP)
    monkeypatch.setattr(shared_memory, "SHARED_MEMORY", tmp_path / "missing")
    made, opened = {}, {RANGE: "SUBNET"}
    (line,) = set_up(made)
    assert line.startswith("/dev/shm has nothing free, DDS needs 32 MiB there: nodes use UDP")
    assert made[PROFILE] == str(LOOPBACK_UDP)
    assert set_up(opened) == [line]
    assert opened == {RANGE: "SUBNET", PROFILE: str(OPEN), TRANSPORTS: "UDPv4", SKIP: "1"}
    mine = tmp_path / "mine.xml"
    mine.touch()
    assert set_up({PROFILE: str(mine)}) == []


@pytest.mark.parametrize("given", ["SUBNETT", "subnet ", "ALL", "LOCALHOST\n"])
def test_a_range_that_is_misspelt_opens_nothing(given: str) -> None:
    with pytest.raises(UserError, match=r"ROS_AUTOMATIC_DISCOVERY_RANGE = .* is none of SUBNET,"):
        set_up({RANGE: given})


def test_peers_without_effect_are_told() -> None:
    (line,) = set_up({"ROS_STATIC_PEERS": "10.0.0.7"})
    assert "ROS_STATIC_PEERS = 10.0.0.7 has no effect" in line
    assert set_up({"ROS_STATIC_PEERS": "10.0.0.7", RANGE: "SUBNET"}) == []


def test_a_wrong_domain_is_refused() -> None:
    with pytest.raises(UserError, match="ROS_DOMAIN_ID = '100000'"):
        set_up({"ROS_DOMAIN_ID": "100000"})


@pytest.mark.parametrize("given", [{}, {RANGE: "SUBNET"}, {TRANSPORTS: "UDPv4"}])
def test_each_domain_has_a_profile_of_its_own(given: dict[str, str]) -> None:
    made: dict[str, dict[str, str]] = {}
    for domain in ("7", "8", "0"):
        made[domain] = {**made.get("7", {}), **given, "ROS_DOMAIN_ID": domain}
        prefer_local(made[domain])
        assert is_local(made[domain]) == (RANGE not in given)
    seven, eight, zero = (Path(each[PROFILE]) for each in made.values())
    assert (seven.name, eight.name) == (f"{zero.stem}-7.xml", f"{zero.stem}-8.xml")
    assert zero in (LOOPBACK, LOOPBACK_UDP, OPEN)
    added = "      <port><portBase>9150</portBase><domainIDGain>0</domainIDGain></port>\n"
    assert seven.read_text() == zero.read_text().replace("    <rtps>\n", f"    <rtps>\n{added}")
    assert ET.parse(seven).getroot().findall(f".//{NAMESPACE}portBase")[0].text == "9150"


def test_a_profile_of_ours_that_is_removed_is_written_again() -> None:
    made = {"ROS_DOMAIN_ID": "7"}
    prefer_local(made)
    Path(made[PROFILE]).unlink()
    again = dict(made)
    prefer_local(again)
    assert again == made
    assert Path(made[PROFILE]).is_file()


@pytest.mark.parametrize(
    ("processes", "given", "profile"),
    [
        (32, {}, LOOPBACK),
        (33, {}, LOOPBACK_MANY),
        (33, {RANGE: "SUBNET"}, OPEN),
        (33, {TRANSPORTS: "LARGE_DATA"}, None),
    ],
)
def test_many_processes_share_no_memory(
    processes: int, given: dict[str, str], profile: Path | None
) -> None:
    made = dict(given)
    set_up(made, processes)
    prefer_local(made)  # as each of the processes does
    assert made.get(PROFILE) == (str(profile) if profile else None)
    udp = processes > 32 and profile is not None
    assert made.get(TRANSPORTS) == ("UDPv4" if udp else given.get(TRANSPORTS))


@pytest.mark.parametrize("name", environment.PROFILE_VARIABLES)
def test_a_profile_that_is_not_there_is_refused(name: str) -> None:
    with pytest.raises(UserError, match=f"{name} = 'absent.xml' is no file: Fast DDS would"):
        set_up({name: "absent.xml"})


def test_without_a_folder_of_ours_the_profile_is_that_of_all_domains(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("XDG_RUNTIME_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "missing" / "file"))
    (tmp_path / "missing").write_text("")
    monkeypatch.setattr("pwd.getpwuid", lambda _: (_ for _ in ()).throw(KeyError))
    made = {"ROS_DOMAIN_ID": "7"}
    prefer_local(made)
    assert made[PROFILE] == str(LOOPBACK)


@pytest.mark.parametrize("profile", [LOOPBACK, LOOPBACK_UDP])
def test_profiles_announce_alike_and_receive_on_loopback(profile: Path) -> None:
    found, opened = ET.parse(profile).getroot(), ET.parse(OPEN).getroot()
    config = f".//{NAMESPACE}discovery_config"

    def text(root: ET.Element, path: str) -> list[str]:
        return [(part.text or "").strip() for part in root.findall(path)]

    assert text(found, f"{config}//*") == text(opened, f"{config}//*")
    addresses = text(found, f".//{NAMESPACE}address")
    assert addresses == ["127.0.0.1"] * 3
    assert text(found, f".//{NAMESPACE}useBuiltinTransports") == ["false"]
    kinds = text(found, f".//{NAMESPACE}type")
    assert kinds == ["UDPv4", "SHM"][: 1 if profile == LOOPBACK_UDP else 2]
