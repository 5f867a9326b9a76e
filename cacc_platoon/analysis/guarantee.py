"""What a verdict guarantees, in one sentence, and the noise that it is judged with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cacc_platoon.model.noise import expected_factor, factor_variance
from cacc_platoon.theory import NoiseStatistics
from cacc_platoon.theory.guarantees import largest_peaks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cacc_platoon.scenario import Follower
    from cacc_platoon.theory import Certificate, Guarantee


_LAGS_DIFFER = (
    " in continuous time; sampled, where lags differ, no frequency of k a_i + k_v v_i + k_p x_i, "
    "which the vehicle behind follows, grows, while |a_i|_2 may a little at some hops"
)


def guarantee_of(
    certificates: Sequence[Certificate], *, equal_links: bool, equal_lags: bool = True
) -> str:
    """Say what certificates prove, of which signal, in which norm, for which noise and links.

    Where lags differ, what a sampled vehicle's acceleration is to the one ahead depends on both
    lags; what it is to ``k a + k_v v + k_p x`` of the one ahead, which it follows, on its own.
    """
    if not certificates:
        return "nothing is guaranteed"
    grown = [one.v2v_growth for one in certificates if one.v2v_growth]
    if any(one.growth > 1.0 for one in grown):
        return "nothing is guaranteed: with packets as rare and late as these errors may grow"
    late = max(certificate.latency for certificate in certificates)
    packets = f", packets {late:g} s late" if late else ""
    rest = f"in the mean over the noise{packets}, for every lag up to"
    if any(certificate.rare for certificate in certificates):
        if not equal_links:
            return "nothing is guaranteed of unequal links with packets at a rate of their own"
        return (
            f"{rest} {certificates[0].tau_max:g} s and every E[w] that all links share, nothing "
            "grows in the long run from vehicle to vehicle with packets at this rate, all sent at "
            "the same instants"
        )
    if equal_links:
        return (
            f"{rest} {certificates[0].tau_max:g} s and every E[w] that all links share, |a_i|_2 "
            "and |delta_i|_2 do not grow from vehicle to vehicle"
        )
    return (
        f"{rest} its tau0 and every E[w_i], |a_i|_2 does not grow from vehicle to vehicle"
        f"{'' if equal_lags else _LAGS_DIFFER}; "
        f"spacing errors may, links being unequal: |delta_i|_2 <= {_largest_error(certificates)}"
    )


def _largest_error(certificates: Sequence[Certificate]) -> str:
    """Return what no |delta_i|_2 of unequal vehicles exceeds, and of which loop it is."""
    worst = max(certificate.leader_error_gain for certificate in certificates)
    held = any(certificate.held < 1.0 for certificate in certificates)
    return f"{worst:.4g} s^2 |a_0|_2" + (", of the loop without losses" if held else "")


def of_unequal(row: Guarantee, certificates: Sequence[Certificate]) -> Guarantee:
    """Make one vehicle's guarantee that of a platoon of unequal ones.

    Of energies of errors and of peaks of accelerations it is the largest; of what is between
    vehicles nothing is said.
    """
    if row.signal == "peaks of a_i":
        return largest_peaks(certificates)
    if row.signal == "energy of delta_i" and all(one.string_stable for one in certificates):
        row = row._replace(mean=f"may grow; at most {_largest_error(certificates)}")
    unsaid = "not said of unequal links" if row.mean_square != "-" else "-"
    peaks = "peaks" in row.signal
    mean = "not said of unequal links" if peaks and row.mean != "-" else row.mean
    return row._replace(mean=mean, mean_square=unsaid, sure="not said of unequal links")


def noise_statistics(follower: Follower, step: float) -> NoiseStatistics:
    """Mean, variance and redraw period of a follower's bit channel, or of no noise at all."""
    v2v = follower.v2v
    redraw = follower.hold_steps * step
    if v2v.noise == "none":
        return NoiseStatistics(redraw_period=redraw)
    mean = expected_factor(v2v.rho, v2v.bit_probabilities)
    if v2v.noise == "expected":
        return NoiseStatistics(mean, redraw_period=redraw)
    return NoiseStatistics(mean, factor_variance(v2v.rho, v2v.bit_probabilities), redraw)
