"""Objects of the user's own that a scenario names as `module:Class`."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cacc_platoon.scenario.parameter import Parameter, ScenarioError

_PATTERN = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def check_plugin(text: str, row: Parameter, source: str) -> None:
    """Refuse a text that is not `module:Class`; nothing is imported."""
    if text and not _PATTERN.fullmatch(text):
        raise row.refusal(text, source, "must be module:Class, such as my_channels:Burst")


def load_plugin(text: str, name: str) -> Callable[..., Any]:
    """Import what a parameter names; modules are also looked for in the working folder.

    This runs code of the user's: nothing that only reads a recorded scenario may call it.

    Raises
    ------
    ScenarioError
        When there is no such module, or it has no such attribute.
    """
    module_name, _, attribute = text.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        factory = getattr(importlib.import_module(module_name), attribute)
    except ModuleNotFoundError as error:
        raise ScenarioError(
            f"{name} = {text}: {error}; the run would lack it. Put the module into the working "
            "folder or on PYTHONPATH."
        ) from error
    except AttributeError as error:
        raise ScenarioError(
            f"{name} = {text}: module {module_name} has no {attribute}. Correct the name."
        ) from error
    if not callable(factory):
        raise ScenarioError(
            f"{name} = {text}: is no class or function, so nothing can be made of it. Name one "
            "that takes a Follower."
        )
    return factory  # type: ignore[no-any-return]
