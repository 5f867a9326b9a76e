"""The parameters of group v2v: when packets are sent, what becomes of them, what they say."""

from __future__ import annotations

from dataclasses import dataclass

from cacc_platoon.scenario.parameter import parameter

PAPER_BITS = (
    *(0.8055, 0.5767, 0.1829, 0.2399, 0.8865, 0.0287, 0.4899, 0.1679),
    *(0.9787, 0.7127, 0.5005, 0.4711, 0.0596, 0.6820, 0.0424, 0.0714),
)


@dataclass(frozen=True)
class V2V:
    """The channel that carries the predecessor's acceleration."""

    rho: float = parameter(
        5.0,
        "-",
        "the linear signal-to-noise ratio",
        above=1.0,
        at_most=1e15,
        consequence="the noise could reverse the sign of the acceleration, or would vanish",
    )
    noise: str = parameter(
        "bits",
        "-",
        "random bits, their expectation E[w], or no noise",
        choices=("bits", "expected", "none"),
    )
    bit_probabilities: tuple[float, ...] = parameter(
        PAPER_BITS,
        "-",
        "the probabilities that bit j is 1, most significant first",
        above=0.0,
        below=1.0,
        consequence="a bit that never changes is no random variable",
    )
    hold: float = parameter(
        0.0,
        "s",
        "the time one draw of the noise is held, 0 for every step",
        at_least=0.0,
        at_most=1e6,
    )
    send_rule: str = parameter(
        "periodic",
        "-",
        "when packets are sent: every v2v.period, or as the sender moves (cam, ETSI EN 302 637-2)",
        choices=("periodic", "cam"),
    )
    cam_check: float = parameter(
        0.1,
        "s",
        "how often cam looks at the motion, a multiple of the control period",
        above=0.0,
        at_most=1.0,
    )
    period: float = parameter(
        0.0,
        "s",
        "the time from packet to packet, 0 for a packet every control period",
        at_least=0.0,
        at_most=1e3,
    )
    phase: float | str = parameter(
        "aligned",
        "s",
        "when a link's first packet is sent: at time 0 (aligned), within the first period "
        "(random), or this long after 0",
        at_least=0.0,
        choices=("aligned", "random"),
    )
    latency: float = parameter(
        0.0,
        "s",
        "the time from sending to arrival, rounded up to control periods",
        at_least=0.0,
        at_most=1e3,
    )
    jitter: float = parameter(
        0.0,
        "s",
        "what is added to the latency of each packet at random: at most this (uniform), or this "
        "in the mean (gamma)",
        at_least=0.0,
        at_most=10.0,
    )
    jitter_law: str = parameter(
        "uniform", "-", "how jitter is distributed", choices=("uniform", "gamma")
    )
    jitter_shape: int = parameter(
        2, "-", "the shape of gamma jitter, 1 for an exponential one", at_least=1, at_most=100
    )
    in_order: bool = parameter(
        False, "-", "whether packets wait for earlier ones that are late; else they overtake them"
    )
    loss: float = parameter(
        0.0,
        "-",
        "the probability that a packet is lost, whatever happens to the others",
        at_least=0.0,
        at_most=1.0,
    )
    best_effort: bool = parameter(
        False,
        "-",
        "whether DDS may lose accelerations on their way to the relay; by clocks (run.sync = wall)",
    )
    burst_begin: float = parameter(
        0.0,
        "-",
        "the probability, from packet to packet, that a time of bad reception begins",
        at_least=0.0,
        at_most=1.0,
    )
    burst_end: float = parameter(
        1.0, "-", "the probability that it ends with the next packet", above=0.0, at_most=1.0
    )
    burst_loss: float = parameter(
        1.0, "-", "the probability that a packet is lost meanwhile", at_least=0.0, at_most=1.0
    )
    blackouts: tuple[float, ...] = parameter(
        (), "s", "times without any packet: when each begins and ends, in turn", at_least=0.0
    )
    bias: float = parameter(
        0.0, "m/s^2", "the error of all accelerations that the sender puts into packets"
    )
    noise_std: float = parameter(
        0.0, "m/s^2", "the standard deviation of an error that differs by packet", at_least=0.0
    )
    quantum: float = parameter(
        0.0,
        "m/s^2",
        "the step to which accelerations are rounded to be sent, 0 for none",
        at_least=0.0,
    )
    saturation: float = parameter(
        0.0, "m/s^2", "the largest acceleration that can be sent, 0 for no limit", at_least=0.0
    )
    false_data: tuple[str, ...] = parameter(
        (),
        "-",
        'times of false data, each "BEGIN END WHAT" in seconds: factor=X multiplies what packets '
        "say, replay=X has them say what was X s ago, frozen what the first of them said",
    )
    reception: str = parameter(
        "hold",
        "-",
        "what a follower uses while packets are lost: the newest value (hold), zero once one is "
        "due, or after a silence a law that needs no V2V (fallback)",
        choices=("hold", "zero", "fallback"),
    )
    fallback_after: float = parameter(
        0.5,
        "s",
        "the silence after which fallback begins",
        above=0.0,
        at_most=1e3,
    )
    fallback_blend: float = parameter(
        1.0, "s", "how long fallback takes to blend in, and out", above=0.0, at_most=1e3
    )
    fallback_return: float = parameter(
        1.0,
        "s",
        "how long packets must come without such a silence before it blends out",
        above=0.0,
        at_most=1e3,
    )
    fallback_headway: float = parameter(
        0.0, "s", "the time headway without V2V, above 2 tau0; 0 for 2.6 tau0", at_least=0.0
    )
    monitor: str = parameter(
        "none",
        "-",
        "whether a follower compares what it receives with how the one ahead moves: not (none), "
        "to say when no w within rho explains both (report), or to fall back meanwhile (fallback)",
        choices=("none", "report", "fallback"),
    )
    monitor_window: float = parameter(
        2.0,
        "s",
        "how far back the monitor looks, longer than packets are apart plus what one takes",
        above=0.0,
        at_most=1e3,
    )
    monitor_margin: float = parameter(
        7.0,
        "-",
        "how many standard deviations the monitor takes for noise of sensor and packets",
        at_least=0.0,
    )
    monitor_jerk: float = parameter(
        10.0,
        "m/s^3",
        "how fast the acceleration ahead may leave and come back, between two packets, the range "
        "of those that they say",
        at_least=0.0,
    )
    channel: str = parameter("", "-", "a custom channel, module:Class, in place of the others")
    receiver: str = parameter(
        "", "-", "a custom reception, module:Class, in place of v2v.reception"
    )
