"""YAML of anybody: bounded in size, depth and expansion before anything is built from it."""

from __future__ import annotations

import warnings
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer, ComposerError
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.scanner import Scanner, ScannerError

from cacc_platoon.texts import TextError, check_size

MAX_NODES = 100_000
"""Keys and values, those behind an alias counted each time it is used."""
MAX_DEPTH = 50
MAX_NUMBER = 100
"""Characters of a number; more digits say nothing."""

_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_BAD_VALUE = (ValueError, KeyError, OverflowError, TypeError, AttributeError, IndexError)
"""What the constructors of a scalar let through when its text is none of its type."""


class YamlTextError(Exception):
    """A text that is no YAML document to be used.

    Attributes
    ----------
    line : int or None
        Where, counted from 1; None when that is not known.
    """

    def __init__(self, text: str, line: int | None = None) -> None:
        super().__init__(text)
        self.line = line


def load_yaml(text: str) -> Any:
    """Return what a YAML text says.

    Raises
    ------
    YamlTextError
        When it is no YAML, has a value that is none of its type, or is larger or deeper than
        `MAX_TEXT`, `MAX_NODES` and `MAX_DEPTH` allow.
    """
    yaml = YAML(typ="safe", pure=True)
    yaml.Scanner, yaml.Composer, yaml.Constructor = _Scanner, _Composer, _Constructor
    try:
        check_size(len(text))
        with warnings.catch_warnings(action="ignore"):
            return yaml.load(text)
    except TextError as error:
        raise YamlTextError(str(error)) from error
    except YAMLError as error:
        mark, position = getattr(error, "problem_mark", None), getattr(error, "position", None)
        line = mark.line + 1 if mark else None
        if isinstance(position, int):
            line = text.count("\n", 0, position) + 1
        problem = getattr(error, "problem", None) or getattr(error, "reason", None)
        raise YamlTextError(str(problem or "it is no YAML document"), line) from error


class _Scanner(Scanner):
    def fetch_more_tokens(self) -> Any:
        """Fetch the next tokens; an escape that is no character is an error of the text."""
        try:
            return super().fetch_more_tokens()
        except (ValueError, OverflowError) as error:
            problem = "an escape in the text is no character"
            raise ScannerError(None, None, problem, self.reader.get_mark()) from error


class _Composer(Composer):
    """Counts nodes and levels while it composes, and what an alias stands for each time."""

    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self.warn_double_anchors = False
        self._level = self._count = 0
        self._sizes: dict[str, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node unless it makes the document larger or deeper than allowed."""
        event = self.parser.peek_event()
        begun = self._count
        if isinstance(event, AliasEvent):
            if event.anchor in self.anchors and event.anchor not in self._sizes:
                self._refuse(f"alias {event.anchor} stands inside of what it stands for", event)
            self._count += self._sizes.get(event.anchor, 0)
        else:
            self._count += 1
            self._sizes.pop(event.anchor, None)
        if self._count > MAX_NODES:
            self._refuse(f"more than {MAX_NODES} keys and values", event)
        if self._level >= MAX_DEPTH:
            self._refuse(f"nested deeper than {MAX_DEPTH} levels", event)
        self._level += 1
        node = super().compose_node(parent, index)
        self._level -= 1
        if event.anchor is not None:
            self._sizes[event.anchor] = self._count - begun
        return node

    def _refuse(self, problem: str, event: Any) -> None:
        raise ComposerError(None, None, problem, event.start_mark)


class _Constructor(SafeConstructor):
    def construct_object(self, node: Any, deep: bool = False) -> Any:
        """Construct a value; one that is none of its type is an error of the text."""
        kind = str(node.tag).rpartition(":")[2]
        text = node.value if isinstance(node, ScalarNode) else ""
        if node.tag in _NUMBERS and len(text) > MAX_NUMBER:
            problem = f"a number of {len(text)} characters, at most {MAX_NUMBER} are read"
            raise ConstructorError(None, None, problem, node.start_mark)
        try:
            return super().construct_object(node, deep)
        except MarkedYAMLError:
            raise
        except _BAD_VALUE as error:
            problem = f"{text[:60]!r} is no value of type {kind}"
            raise ConstructorError(None, None, problem, node.start_mark) from error
