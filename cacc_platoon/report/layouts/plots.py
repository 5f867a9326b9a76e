"""What a viewer shows of a platoon, whichever viewer it is: which topics, in which plots."""

from __future__ import annotations

from typing import NamedTuple

from cacc_platoon.figures.style import BLUE, ORANGE, spread
from cacc_platoon.report.layouts.view import View
from msg_adapters.topics import Topic

MOST_CURVES = 25
"""More curves in one plot cannot be told apart; the others are there but hidden at first."""


class Curve(NamedTuple):
    """One number of a topic over time.

    Attributes
    ----------
    label : str
        What the legend says.
    topic : Topic
        The topic; its kind knows the path of the number.
    colour : str
        #rrggbb.
    shown : bool
        Whether it is drawn before somebody asks for it.
    """

    label: str
    topic: Topic
    colour: str
    shown: bool = True


class Plot(NamedTuple):
    """Curves of one quantity.

    Attributes
    ----------
    key : str
        A word to refer to it by.
    title, unit : str
        What it says above and beside.
    curves : tuple of Curve
        From the leader's to the last vehicle's.
    """

    key: str
    title: str
    unit: str
    curves: tuple[Curve, ...]


def plots(view: View) -> list[Plot]:
    """Return the plots of what is in the topics, nothing computed."""
    scenario, vehicle = view.scenario, view.vehicle
    everyone, followers = scenario.vehicles, scenario.indices
    found = [
        Plot("speed", "Speed v_i", "m/s", _curves(view, [vehicle(i).twist for i in everyone])),
        Plot(
            "acceleration",
            "Acceleration a_i",
            "m/s^2",
            _curves(view, [vehicle(i).accel for i in everyone]),
        ),
        _first_link(view),
    ]
    if view.graph.spacing_error:
        topics = [vehicle(i).spacing_error for i in followers]
        found.append(Plot("spacing", "Spacing error delta_i", "m", _curves(view, topics)))
    if view.graph.command:
        topics = [vehicle(i).command for i in followers]
        found.append(Plot("command", "Command u_i", "m/s^2", _curves(view, topics)))
    return found


def _curves(view: View, topics: list[Topic]) -> tuple[Curve, ...]:
    """Return one curve a vehicle, the last one's last."""
    colours = view.colours()
    indices = list(colours)[-len(topics) :]
    shown = {indices[place] for place in spread(len(indices), MOST_CURVES)}
    return tuple(
        Curve(f"vehicle {index}", topic, colours[index], index in shown)
        for index, topic in zip(indices, topics, strict=True)
    )


def _first_link(view: View) -> Plot:
    """Return what the leader sends and the first follower receives."""
    leader, first = view.scenario.leader_index, view.scenario.indices[0]
    curves = (
        Curve(f"sent by vehicle {leader}", view.vehicle(leader).accel, BLUE.lower()),
        Curve(f"received by vehicle {first}", view.vehicle(first).received, ORANGE.lower()),
    )
    title = f"Link {leader} to {first}: sent and received acceleration"
    return Plot("link", title, "m/s^2", curves)
