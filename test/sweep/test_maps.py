"""What is drawn of a study: places in order, means over the rest, nothing where anything lacks."""

from pathlib import Path

import numpy as np

from cacc_platoon.sweep.maps import maps
from cacc_platoon.sweep.plan import parse_plan
from cacc_platoon.sweep.rows import RowResult

PLAN = parse_plan(
    {
        "matrix": {"v2v.rho": [3.0, 10.0, 5.0], "controller.time_headway": [1.0, 0.9]},
        "seeds": [1, 2],
        "columns": ["min_gap", "loss"],
        "criteria": ["min_gap > 40"],
    },
    "mine",
    Path(),
)


def test_places_are_in_order_and_what_is_unknown_is_not_drawn():
    rows = {}
    for point in PLAN.points():
        rho, headway, seed = point.labels.values()
        gap = 10.0 * rho + headway + seed
        rows[point.row] = RowResult(
            point.row, {"min_gap": gap, "loss": 0.0}, {"min_gap > 40": gap > 40}
        )
    rows[3] = RowResult(3, {}, {}, "failed")  # rho 3, headway 0.9, seed 2
    met, gap = maps(PLAN, rows)  # the loss is the same everywhere
    assert (met.name, gap.name) == ("min_gap > 40", "min_gap")
    assert gap.over == ("run.seed",)
    assert [axis.title for axis in gap.axes] == ["v2v.rho [-]", "controller.time_headway [s]"]
    expected = [[np.nan, 32.5], [52.4, 52.5], [102.4, 102.5]]
    np.testing.assert_allclose(gap.values, expected)
    np.testing.assert_array_equal(met.values, [[np.nan, 0.0], [1.0, 1.0], [1.0, 1.0]])
    assert met.share
    assert not gap.share
