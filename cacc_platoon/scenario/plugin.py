"""Objects of the user's own that a scenario names as `module:Class`."""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cacc_platoon.errors import UserError
from cacc_platoon.scenario.parameter import Parameter, ScenarioError

_PATTERN = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")


def check_plugin(text: str, row: Parameter, source: str) -> None:
    """Refuse a text that is not `module:Class`; nothing is imported."""
    if text and not _PATTERN.fullmatch(text):
        raise row.refusal(text, source, "must be module:Class, such as my_channels:Burst")


def make_plugin(text: str, name: str, argument: object, members: Sequence[str]) -> Any:
    """Make what a parameter names; modules are also looked for in the working folder.

    This runs code of the user's: nothing that only reads a recorded scenario may call it.

    Parameters
    ----------
    text : str
        `module:Class`.
    name : str
        The parameter.
    argument : object
        What the class or function is called with.
    members : sequence of str
        What the object must have.

    Raises
    ------
    ScenarioError
        When there is no such module or class, or it makes no such object.
    """
    factory = _load(text, name)
    try:
        made = factory(argument)
        missing = [member for member in members if not hasattr(made, member)]
    except UserError:
        raise
    except (Exception, SystemExit) as error:
        raise ScenarioError(
            f"{name} = {text}: raised {_one_line(error)} when it was made for vehicle "
            f"{getattr(argument, 'index', '')}; the run would lack it. Correct its code."
        ) from error
    if missing:
        raise ScenarioError(
            f"{name} = {text}: makes a {type(made).__name__} without {', '.join(missing)}, which "
            "no node can use. Give it these members, see CONTRIBUTING.md."
        )
    return made


def source_of(module: str) -> str:
    """Return the text of a module of the user's own, empty where none is found; it is not run."""
    _look_here()
    try:
        spec = importlib.util.find_spec(module)
        return Path(spec.origin).read_text(errors="replace") if spec and spec.origin else ""
    except (ImportError, ValueError, OSError):
        return ""


def _look_here() -> None:
    """Let modules be found in the working folder, too."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def _load(text: str, name: str) -> Callable[..., Any]:
    module_name, _, attribute = text.partition(":")
    _look_here()
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise ScenarioError(
            f"{name} = {text}: {error}; the run would lack it. Put the module into the working "
            "folder or on PYTHONPATH."
        ) from error
    except (Exception, SystemExit) as error:
        raise ScenarioError(
            f"{name} = {text}: raised {_one_line(error)} when it was imported; the run would lack "
            "it. Correct its code."
        ) from error
    factory = getattr(module, attribute, None)
    if not callable(factory):
        raise ScenarioError(
            f"{name} = {text}: module {module_name} has no class or function {attribute}, so "
            "nothing can be made of it. Name one that takes a Follower."
        )
    return factory  # type: ignore[no-any-return]


def _one_line(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())
