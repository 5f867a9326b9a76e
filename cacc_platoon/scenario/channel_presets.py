"""Channels by name, such as sidelink_low: values of group v2v, each with its source in its file."""

from __future__ import annotations

import json
from pathlib import Path

from cacc_platoon.scenario.parameter import ScenarioError, flatten
from cacc_platoon.scenario.yaml_text import load_yaml

_FOLDER = Path(__file__).parent / "channels"


def channel_names() -> list[str]:
    """Return the names that there are."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def channel_settings(name: str) -> list[str]:
    """Return a channel as `key=value` texts, as `--set` takes them.

    Raises
    ------
    ScenarioError
        When there is no such channel.

    Examples
    --------
    >>> channel_settings("gilbert_tamu")[1:3]
    ['v2v.burst_begin=0.3', 'v2v.burst_end=0.3']
    """
    if name not in channel_names():
        raise ScenarioError(
            f"--channel = {name[:60]!r} is no channel: nothing would be known of the packets. Give "
            f"{', '.join(channel_names())}, or set what you want with --set v2v.KEY=VALUE."
        )
    values = flatten(load_yaml((_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")))
    return [f"{key}={json.dumps(value)}" for key, value in values.items()]
