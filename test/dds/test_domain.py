"""Which domains there are, and that two runs never hold the same one."""

import pytest

from cacc_platoon.dds import domain
from cacc_platoon.dds.domain import domain_of, own_domain
from cacc_platoon.errors import UserError


@pytest.mark.parametrize("text", ["", "0", "42", "101", "232", " 7 "])
def test_a_domain_that_there_is_passes(text: str) -> None:
    assert domain_of({"ROS_DOMAIN_ID": text}) == int(text or 0)


@pytest.mark.parametrize("text", ["233", "100000", "-1", "a", "1.0", "9" * 5000, "٣", "1 2", "07"])
def test_a_domain_without_ports_is_refused(text: str) -> None:
    with pytest.raises(
        UserError, match=r"ROS_DOMAIN_ID = .* is no DDS domain, .* 0 to 232"
    ) as told:
        domain_of({"ROS_DOMAIN_ID": text})
    assert len(str(told.value)) < 300


def test_a_domain_is_held_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(domain, "DOMAINS", range(90_001, 90_003))
    with own_domain() as first:
        with own_domain() as second:
            assert {first, second} == {90_001, 90_002}
            with pytest.raises(UserError, match="from 90001 to 90002 are held"), own_domain():
                pass
        with own_domain() as third:
            assert third == second
