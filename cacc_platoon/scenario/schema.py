"""The JSON Schema of scenario files, made from the parameter table; editors complete keys by it."""

from __future__ import annotations

from typing import Any

from cacc_platoon.scenario.file import FORMAT
from cacc_platoon.scenario.parameter import Parameter
from cacc_platoon.scenario.ros_sections import SECTION
from cacc_platoon.scenario.table import GROUPS, SNR_DB, TABLE

TYPES: dict[str, list[dict[str, Any]]] = {
    "float": [{"type": "number"}],
    "int": [{"type": "integer"}],
    "bool": [{"type": "boolean"}],
    "str": [{"type": "string"}],
    "tuple[float, ...]": [{"type": "array", "items": {"type": "number"}}],
    "tuple[str, ...]": [{"type": "array", "items": {"type": "string"}}],
    "float | tuple[float, ...]": [
        {"type": "number"},
        {"type": "array", "items": {"type": "number"}},
    ],
    "int | str": [{"type": "integer"}, {"type": "string"}],
    "float | str": [{"type": "number"}, {"type": "string"}],
}
LIMITS = {
    "above": "exclusiveMinimum",
    "at_least": "minimum",
    "below": "exclusiveMaximum",
    "at_most": "maximum",
}


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a scenario file."""
    rows = [*TABLE.values(), SNR_DB]
    groups = {
        group: {
            "type": "object",
            "description": (owner.__doc__ or "").partition("\n")[0],
            "properties": {
                row.name.partition(".")[2]: _value(row)
                for row in rows
                if row.name.startswith(f"{group}.")
            },
            "additionalProperties": False,
        }
        for group, owner in GROUPS.items()
    }
    section = {
        "type": "object",
        "description": "Parameters of the nodes that the key above matches, in groups.",
        "properties": groups,
        "additionalProperties": False,
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "scenario.yaml",
        "description": (
            "A ROS 2 parameter file that defines a run; made by `platoon parameters --schema`. "
            f"The comment `# {FORMAT.name}, format {FORMAT.version}` in its head is its version."
        ),
        "type": "object",
        "patternProperties": {
            "^/": {
                "type": "object",
                "description": "/** for the whole platoon, <prefix>/vehicle_<i>/* for one vehicle.",
                "properties": {SECTION: section},
                "required": [SECTION],
                "additionalProperties": False,
            }
        },
        "additionalProperties": False,
    }


def _value(row: Parameter) -> dict[str, Any]:
    """Return the schema of one parameter's value."""
    unit = "" if row.unit == "-" else f" [{row.unit}]"
    default = list(row.default) if isinstance(row.default, tuple) else row.default
    about = {"description": f"{row.meaning}{unit}", "default": default}
    kinds = [_limited(kind, row) for kind in TYPES[row.kind]]
    return {**about, **kinds[0]} if len(kinds) == 1 else {**about, "anyOf": kinds}


def _limited(kind: dict[str, Any], row: Parameter) -> dict[str, Any]:
    """Return the schema of a type within the row's range."""
    match kind["type"]:
        case "array":
            return {**kind, "items": _limited(kind["items"], row)}
        case "string":
            return {**kind, "enum": list(row.choices)} if row.choices else kind
        case "boolean":
            return kind
    limits = {word: getattr(row, name) for name, word in LIMITS.items()}
    return {**kind, **{word: limit for word, limit in limits.items() if limit is not None}}
