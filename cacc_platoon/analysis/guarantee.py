"""What a verdict guarantees, in one sentence, and the noise that it is judged with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cacc_platoon.model.noise import expected_factor, factor_variance
from cacc_platoon.theory import NoiseStatistics
from cacc_platoon.theory.guarantees import largest_peaks, left_out, sampled_too_slowly

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cacc_platoon.scenario import Follower
    from cacc_platoon.theory import Certificate, Guarantee


_LAGS_DIFFER = (
    "sampled, where lags differ, no frequency of k a_i as received + k_v v_i + k_p x_i, which the "
    "vehicle behind follows, grows, while |a_i|_2 may a little at some hops"
)


def guarantee_of(
    certificates: Sequence[Certificate],
    *,
    equal_links: bool,
    equal_lags: bool = True,
    alone: bool = False,
) -> str:
    """Say what certificates prove, of which signal, in which norm, for which noise and links.

    Where lags differ, what a sampled vehicle's acceleration is to the one ahead depends on both
    lags; what it is to ``k a + k_v v + k_p x`` of the one ahead, which it follows, on its own.
    A leader's acceleration may change between control instants, so that what its samples are to a
    follower's is not that of the sampled loop. The only follower of a platoon is `alone`: there is
    no hop but the one from its leader.
    """
    if nothing := _nothing(certificates):
        return nothing
    late = max(certificate.latency for certificate in certificates)
    packets = f", packets {late:g} s late" if late else ""
    lossy = any(
        certificate.held < 1.0 or certificate.reception < 1.0 for certificate in certificates
    )
    mean = f"in the mean over the noise{' and all losses' if lossy else ''}{packets}"
    whose = "" if alone else " that all links share"
    rest = f"{mean}, for every lag up to {certificates[0].tau_max:g} s and every E[w]{whose}"
    if any(certificate.rare for certificate in certificates):
        return _with_rare_packets(rest, equal_links=equal_links, alone=alone)
    of_loop = max((left_out(certificate) for certificate in certificates), key=len)
    if alone:
        return (
            f"{rest}, in continuous time, the follower's |a|_2 is at most that of the vehicle "
            f"ahead, |a_0|_2, and its |delta|_2 at most {_largest_error(certificates)}"
        )
    first = "" if of_loop else ", nor, in continuous time, |a_i|_2 from the leader to the first"
    if equal_links:
        return f"{rest}, |a_i|_2 and |delta_i|_2 do not grow from follower to follower{first}"
    hop = f"vehicle to vehicle in continuous time{of_loop}; {_LAGS_DIFFER}"
    if equal_lags:
        hop = f"follower to follower{first}"
    return (
        f"{mean}, for every lag up to its tau0 and every E[w_i], |a_i|_2 does not grow from {hop}; "
        "spacing errors may, links being unequal: in continuous time "
        f"|delta_i|_2 <= {_largest_error(certificates)}"
    )


def _nothing(certificates: Sequence[Certificate]) -> str:
    """Say that nothing is guaranteed where it is so; empty elsewhere."""
    if not certificates:
        return "nothing is guaranteed"
    grown = [one.v2v_growth for one in certificates if one.v2v_growth]
    if any(one.growth > 1.0 for one in grown):
        return "nothing is guaranteed: with packets as rare and late as these errors may grow"
    if any(sampled_too_slowly(certificate) for certificate in certificates):
        return "nothing is guaranteed: sampled as slowly as this errors may grow"
    return ""


def _with_rare_packets(rest: str, *, equal_links: bool, alone: bool) -> str:
    if not equal_links:
        return "nothing is guaranteed of unequal links with packets at a rate of their own"
    where = "along a platoon of such followers" if alone else "from vehicle to vehicle"
    return (
        f"{rest}, nothing grows in the long run {where} with packets at this rate, all sent at the "
        f"same instants{', which says nothing of one hop' if alone else ''}"
    )


def _largest_error(certificates: Sequence[Certificate]) -> str:
    """Return what no |delta_i|_2 of unequal vehicles exceeds, and of which loop it is."""
    worst = max(certificate.leader_error_gain for certificate in certificates)
    return f"{worst:.4g} s^2 |a_0|_2" + max((left_out(one) for one in certificates), key=len)


def of_alone(row: Guarantee, certificate: Certificate) -> Guarantee:
    """Make a guarantee one of a single follower, whose errors have none before them."""
    if row.signal == "energy of a_i" and certificate.rare:
        return row._replace(mean=f"along a platoon of such followers it {row.mean}")
    slow = sampled_too_slowly(certificate)
    known = certificate.internally_stable and not (certificate.rare or slow)
    if row.signal == "energy of delta_i" and known:
        return row._replace(mean=f"at most {_largest_error([certificate])}")
    return row


def of_unequal(row: Guarantee, certificates: Sequence[Certificate]) -> Guarantee:
    """Make one vehicle's guarantee that of a platoon of unequal ones.

    Of energies of errors and of peaks of accelerations it is the largest; of what is between
    vehicles nothing is said, nor of energies where packets have a rate of their own.
    """
    if row.signal == "peaks of a_i":
        return largest_peaks(certificates)
    if row.signal == "energy of delta_i" and all(one.string_stable for one in certificates):
        slow = any(sampled_too_slowly(one) for one in certificates)
        when = "in continuous time " if slow else ""
        row = row._replace(mean=f"may grow; {when}at most {_largest_error(certificates)}")
    unsaid = "not said of unequal links" if row.mean_square != "-" else "-"
    of_equal = "peaks" in row.signal or any(one.rare for one in certificates)
    mean = "not said of unequal links" if of_equal and row.mean != "-" else row.mean
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
