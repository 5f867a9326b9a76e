"""What a design guarantees against which noise, in words: one table for every place that says it.

In the mean is a statement about expectations, with every ``E[w]`` in ``[m, M]``. In the mean square
is one about the energy that noise of given statistics adds. Whatever the noise does is one about
every run: ``w(t)`` anywhere in ``[m, M]`` at every instant
(docs/theory.md, section 13 (What is proven and what is numerical)).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from cacc_platoon.theory.errors import DesignError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from cacc_platoon.theory.certificate import Certificate
    from cacc_platoon.theory.peak_gains import WorstGain

__all__ = ["Guarantee", "guarantees", "largest_peaks", "left_out", "sampled_too_slowly"]

NONE = "-"
_RINGS = "the loop rings too long for a bound"
_SILENT = "nothing is communicated: as in the mean"


class Guarantee(NamedTuple):
    """What holds for one signal; ``-`` where nothing is said.

    Attributes
    ----------
    signal : str
        Of which signal, in which norm.
    mean, mean_square, sure : str
        In the mean, in the mean square, and whatever the noise does.
    """

    signal: str
    mean: str
    mean_square: str
    sure: str


def guarantees(certificate: Certificate, *, equal_links: bool = True) -> tuple[Guarantee, ...]:
    """Say what a design guarantees.

    Parameters
    ----------
    certificate : Certificate
        The design.
    equal_links : bool, optional
        Whether all vehicles and links are equal, ``E[w_i]`` too, so that
        ``delta_i = H delta_{i-1}``.

    Examples
    --------
    >>> from cacc_platoon.model.control import Gains
    >>> from cacc_platoon.theory.certificate import certify
    >>> for row in guarantees(certify(Gains(0.95, 0.5, 0.63, 0.009), 5.0, 0.5))[:2]:
    ...     print(row.signal, "|", row.mean)
    energy of a_i | does not grow: sup|H| = 1
    peaks of a_i | grow by a factor of at most 1.04 per hop (no lag above 1.05)
    """
    stable = certificate.string_stable
    of_loop = left_out(certificate)
    gain = f"sup|H| = {certificate.l2_gain:.7g}{of_loop}"
    when = "in continuous time " if sampled_too_slowly(certificate) else ""
    return (
        Guarantee(
            "energy of a_i",
            _with_packets(certificate)
            or (f"does not grow: {gain}" if stable else f"may grow: {gain}"),
            _mean_square(certificate),
            "no design that listens keeps it from growing" if certificate.gains.k_a else _SILENT,
        ),
        largest_peaks([certificate]),
        Guarantee("energy of delta_i", _error_energy(certificate, equal=equal_links), NONE, NONE),
        Guarantee(
            "peaks of delta_i",
            f"{when}at most {certificate.leader_error_norm:.4g} s^1.5 |a_0|_2{of_loop}"
            if stable
            else NONE,
            NONE,
            _known(lambda: _error_peaks(certificate)),
        ),
        Guarantee("a_i, noise that never changes", NONE, _frozen(certificate), NONE),
    )


def largest_peaks(certificates: Sequence[Certificate]) -> Guarantee:
    """Say what holds for the peaks of every vehicle's acceleration, each against the one before."""

    def largest(gains: Iterable[WorstGain]) -> WorstGain:
        return max(gains, key=lambda worst: worst.gain)

    parts = max((left_out(one) for one in certificates), key=len)
    return Guarantee(
        "peaks of a_i",
        _known(lambda: _peaks(largest(one.worst_linf_gain for one in certificates))) + parts,
        NONE,
        _known(lambda: _peaks(largest(one.worst_sure_gain for one in certificates))),
    )


def left_out(certificate: Certificate) -> str:
    """Say what the gains of the mean loop, which is in continuous time, leave out."""
    losses = ["losses"] if certificate.held < 1.0 else []
    parts = [*losses, *(["latency"] if certificate.latency else [])]
    parts += ["a V2V period of its own"] if certificate.rare else []
    return f", of the loop without {' and '.join(parts)}" if parts else ""


def sampled_too_slowly(certificate: Certificate) -> bool:
    """Return whether a string stable loop is not so sampled at its control period."""
    return certificate.string_stable and not certificate.sampled_string_stable


def _with_packets(certificate: Certificate) -> str:
    """Say what holds where packets are rare, or where errors grow since they or samples are late.

    With packets at a rate of their own that is what holds in the long run.
    """
    found = certificate.v2v_growth
    if found is None or not (certificate.rare or found.growth > 1.0):
        if sampled_too_slowly(certificate):
            return (
                f"may grow: not string stable sampled every {certificate.period:g} s; in "
                f"continuous time sup|H| = {certificate.l2_gain:.7g}{left_out(certificate)}"
            )
        return ""
    grows = f"grows by {found.growth:.6g} per hop" if found.growth > 1.0 else "does not grow"
    late = f", {certificate.latency:g} s late" if certificate.latency else ""
    return (
        f"{grows} in the long run with a packet every {certificate.v2v_period:g} s{late}, sent at "
        "the same instants"
    )


def _known(say: Callable[[], str]) -> str:
    try:
        return say()
    except DesignError:
        return _RINGS


def _mean_square(certificate: Certificate) -> str:
    if certificate.gains.k_a == 0.0:
        return _SILENT
    noise, index = certificate.noise, certificate.mean_square_index
    given = f"c_T = {index:.4g} at E[w] = {noise.mean:.4g}, Var[w] = {noise.variance:.3g}"
    if math.isnan(index):
        return "not known: packets are lost or late, or the noise is as good as frozen"
    if index >= 1.0:
        return f"grows along a platoon of such followers at some lag: {given}"
    if index == 0.0:
        return "no noise is given"
    if noise.redraw_period > 1.5 * certificate.period:
        return f"stays bounded: {given}"
    return f"at most {1.0 / (1.0 - index):.6g} times the leader's: {given}"


def _frozen(certificate: Certificate) -> str:
    if certificate.gains.k_a == 0.0:
        return _SILENT
    margin = certificate.frozen_noise_margin
    if math.isnan(margin):
        return "not known: packets are lost or late"
    if margin < 0:
        return f"E|a_i(jw)|^2 may grow: margin {margin:.4g}"
    return f"E|a_i(jw)|^2 does not grow at any frequency: margin {margin:.4g}"


def _peaks(worst: WorstGain) -> str:
    if not math.isfinite(worst.gain):
        return "grow without bound"
    grow = f"grow by a factor of at most {worst.gain:.4g} per hop"
    if worst.gain <= 1.0 + 1e-9:
        grow = "do not grow"
    if worst.at_most == worst.gain:
        return grow
    if not math.isfinite(worst.at_most):
        return f"{grow} at the lags that were tried; {_RINGS}"
    return f"{grow} (no lag above {math.ceil(worst.at_most * 100.0 - 1e-9) / 100.0:.2f})"


def _error_energy(certificate: Certificate, *, equal: bool) -> str:
    growth = certificate.v2v_growth
    if not certificate.string_stable or (growth is not None and growth.growth > 1.0):
        return "may grow"
    if certificate.rare:
        return "not known: packets have a period of their own"
    if sampled_too_slowly(certificate):
        return "may grow; only in continuous time do they not, where all links are equal"
    if equal:
        parts = left_out(certificate) if growth is None else ""
        return f"does not grow from the second vehicle on{parts}"
    most = f"may grow; at most {certificate.leader_error_gain:.4g} s^2 |a_0|_2"
    return most + left_out(certificate)


def _error_peaks(certificate: Certificate) -> str:
    error, gain = certificate.worst_sure_error_gain.at_most, certificate.worst_sure_gain.at_most
    if not certificate.internally_stable:
        return "grow without bound"
    if not (math.isfinite(error) and math.isfinite(gain)):
        return _RINGS
    return f"at most {error:.4g} s^2 max|a_(i-1)|, and {error:.4g} * {gain:.4g}^(i-1) s^2 max|a_0|"
