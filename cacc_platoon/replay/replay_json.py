"""replay.json: whether a replayed node published the same, or what it would have done instead."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cacc_platoon.formats import Format
from cacc_platoon.replay.comparison import Difference
from cacc_platoon.replay.node_record import NodeRecord
from cacc_platoon.replay.what_if import Motion, WhatIf

FORMAT = Format("replay.json", 1)


def comparison_document(
    record: NodeRecord, difference: Difference | None = None, causes: Sequence[str] = ()
) -> dict[str, Any]:
    """Return what a replay with the recorded parameters says.

    Parameters
    ----------
    record : NodeRecord
        What was recorded.
    difference : Difference, optional
        The first message that differs; None when all are identical.
    causes : sequence of str, optional
        What may have caused it.
    """
    document = _about(record)
    document |= {"identical": difference is None, "first_difference": None}
    if difference:
        document |= {"first_difference": _difference(difference), "possible_causes": list(causes)}
    return document


def what_if_document(record: NodeRecord, settings: Sequence[str], answer: WhatIf) -> dict[str, Any]:
    """Return what a replay with other parameters says.

    Parameters
    ----------
    record : NodeRecord
        What was recorded.
    settings : sequence of str
        The parameters that were changed, `key=value`.
    answer : WhatIf
        What the vehicle did and would have done.
    """
    return _about(record) | {
        "set": list(settings),
        "recorded": _motion(answer.recorded),
        "replayed": _motion(answer.replayed),
    }


def _about(record: NodeRecord) -> dict[str, Any]:
    return {
        "format": FORMAT.version,
        "vehicle": record.index,
        "node": record.node,
        "samples": record.samples,
        "messages": sum(stream.count(record.samples) for stream in record.outputs),
        "notes": list(record.notes),
        "standing": record.standing.to_json(),
    }


def _difference(difference: Difference) -> dict[str, Any]:
    return {
        "topic": difference.topic,
        "sample": difference.sample,
        "time": difference.time,
        "recorded": _finite(difference.recorded),
        "replayed": _finite(difference.replayed),
        "what": difference.what,
    }


def _finite(value: float | None) -> float | None:
    """Return a number as JSON can have it; what it was is in the words of the difference."""
    return value if value is not None and math.isfinite(value) else None


def _motion(motion: Motion) -> dict[str, Any]:
    return {
        "max_abs_spacing_error": motion.max_abs_spacing_error,
        "min_gap": motion.min_gap,
        "max_abs_acceleration": motion.max_abs_acceleration,
    }
