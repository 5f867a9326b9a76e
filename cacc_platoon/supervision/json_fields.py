"""JSON messages from anybody, read field by field: each is what it has to be, or one error.

Nothing here fails in any other way, whatever the text: neither nesting nor size, neither endless
numbers nor characters that cannot be printed get past it.
"""

from __future__ import annotations

import json
import math
import re
from enum import StrEnum
from typing import NoReturn, TypeAlias, TypeVar

VERSION = 4
MAX_CHARACTERS = 4 * 2**20
"""Of a whole message; the largest host there can be, of 1001 nodes, takes a tenth of it."""
MAX_TEXT = 10_000
"""Characters of a single text: a name, a path, a reason."""
MAX_INTEGER = 2**63 - 1

Scalar: TypeAlias = bool | int | float | str
Value: TypeAlias = Scalar | list[Scalar]
"""A parameter's value."""

_HOST = re.compile(r"(?=.{1,100}\Z)[A-Za-z0-9]+(_[A-Za-z0-9]+)*", re.ASCII | re.DOTALL)
"""What may follow host_ in the name of a topic: ROS takes no two underscores in a row."""
_NOT_SENDABLE = re.compile("[\0\ud800-\udfff]")


class ProtocolError(Exception):
    """A text that is no message of ours; the line says what is wrong with it."""


class OtherVersionError(ProtocolError):
    """A message of ours from another version of cacc_platoon, which speaks another format."""


def sendable(text: str) -> str:
    r"""Return a text as it may be sent: without NUL and lone surrogates, and not endless.

    Examples
    --------
    >>> sendable("no\0nsense")
    'no?nsense'
    """
    return _NOT_SENDABLE.sub("?", text[:MAX_TEXT])


Choice = TypeVar("Choice", bound=StrEnum)


class Fields:
    """The fields of a JSON object; each is taken by key and is of the type asked for, or refused.

    Parameters
    ----------
    value : object
        What should be the object.
    what : str
        What to call it in an error.
    """

    def __init__(self, value: object, what: str) -> None:
        if not isinstance(value, dict):
            raise ProtocolError(f"{what} is {_kind(value)}, not an object")
        self._fields, self._what = value, what

    @classmethod
    def of_message(cls, text: str) -> Fields:
        """Return the fields of a whole message of a version that is understood."""
        if len(text) > MAX_CHARACTERS:
            raise ProtocolError(f"the message has {len(text)} characters, over {MAX_CHARACTERS}")
        try:
            value = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ProtocolError("the message is not JSON that can be read") from error
        fields = cls(value, "the message")
        version = fields.integer("format", at_least=1)
        if version != VERSION:
            raise OtherVersionError(
                f"the message is of format {version}, but this version of cacc_platoon understands "
                f"format {VERSION}. Use the same version of cacc_platoon for all nodes"
            )
        return fields

    def text(self, key: str) -> str:
        """Return a text, which may be empty."""
        return _text(self._get(key), key)

    def name(self, key: str) -> str:
        """Return a text that is not empty."""
        return self.text(key) or self._refuse(key, "a text that is not empty")

    def host(self, key: str) -> str:
        """Return the name of a host."""
        name = self.text(key)
        wanted = "the name of a host (letters, digits, underscores)"
        return name if _HOST.fullmatch(name) else self._refuse(key, wanted)

    def integer(self, key: str, at_least: int) -> int:
        """Return a whole number."""
        value = self._get(key)
        if type(value) is not int or not at_least <= value <= MAX_INTEGER:
            return self._refuse(key, f"a whole number from {at_least} on")
        return value

    def choice(self, key: str, kind: type[Choice]) -> Choice:
        """Return one of an enumeration."""
        value = self.text(key)
        if value not in list(kind):
            return self._refuse(key, f"one of {', '.join(kind)}")
        return kind(value)

    def items(self, key: str) -> list[object]:
        """Return a list of anything."""
        value = self._get(key)
        return value if isinstance(value, list) else self._refuse(key, "a list")

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts."""
        return tuple(_text(item, f"an item of {key}") for item in self.items(key))

    def counts(self, key: str) -> dict[str, int]:
        """Return whole numbers by name."""
        fields = self.object_at(key)
        return {name: fields.integer(name, at_least=0) for name in fields.names()}

    def parameters(self, key: str) -> dict[str, dict[str, Value]]:
        """Return the values of parameters, by node and name."""
        nodes = self.object_at(key)
        return {node: nodes.object_at(node).values() for node in nodes.names()}

    def names(self) -> list[str]:
        """Return the names of all fields."""
        return [_text(name, f"a name in {self._what}") for name in self._fields]

    def values(self) -> dict[str, Value]:
        """Return all fields, each the value of a parameter."""
        return {name: _value(self._fields[name], _short(name)) for name in self.names()}

    def object_at(self, key: str) -> Fields:
        """Return the fields of an object within."""
        return Fields(self._get(key), _short(key))

    def _get(self, key: str) -> object:
        if key not in self._fields:
            raise ProtocolError(f"{self._what} has no {key}")
        return self._fields[key]

    def _refuse(self, key: str, wanted: str) -> NoReturn:
        raise ProtocolError(f"{_short(key)} is {_kind(self._fields[key])}, not {wanted}")


def _text(value: object, what: str) -> str:
    if not isinstance(value, str):
        raise ProtocolError(f"{what} is {_kind(value)}, not a text")
    if len(value) > MAX_TEXT:
        raise ProtocolError(f"{what} is a text of {len(value)} characters, over {MAX_TEXT}")
    if _NOT_SENDABLE.search(value):
        raise ProtocolError(f"{what} is a text with characters that nobody can print")
    return value


def _value(value: object, what: str) -> Value:
    """Return a parameter's value: a flag, a number, a text, or a list of such."""
    if isinstance(value, list):
        return [_scalar(item, what) for item in value]
    return _scalar(value, what)


def _scalar(value: object, what: str) -> Scalar:
    match value:
        case bool():
            return value
        case int() if abs(value) <= MAX_INTEGER:
            return value
        case float() if math.isfinite(value):
            return value
        case str():
            return _text(value, what)
    raise ProtocolError(f"{what} is {_kind(value)}, not the value of a parameter")


def _kind(value: object) -> str:
    """Say what a JSON value is, in a few characters whatever it is."""
    match value:
        case None | bool():
            return json.dumps(value)
        case int() if abs(value) > MAX_INTEGER:
            return "an endless number"
        case int() | float():
            return repr(value)
        case str():
            return repr(value[:30])
        case list():
            return "a list"
    return "an object"


def _short(name: str) -> str:
    """Return a name as it may stand in a line, whoever gave it."""
    return name if name.isidentifier() and len(name) <= 30 else repr(name[:30])
