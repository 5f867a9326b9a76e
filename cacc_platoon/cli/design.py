"""Choose time headway and gains for an SNR and an actuation lag, and certify a design."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path

from cacc_platoon.design.question import Question, answer
from cacc_platoon.design.requirements import Recommendation, Requirements, paper_design
from cacc_platoon.model.control import Gains
from cacc_platoon.model.noise import expected_factor, factor_variance
from cacc_platoon.report.design_figures import save_design_figures
from cacc_platoon.report.design_terminal import render
from cacc_platoon.scenario import Scenario
from cacc_platoon.scenario.file import format_scenario
from cacc_platoon.scenario.v2v_parameters import V2V
from cacc_platoon.theory.errors import DesignError
from cacc_platoon.theory.explanation import explain_bounds, explain_design
from cacc_platoon.theory.human_driver import HumanDriver
from cacc_platoon.theory.mean_square import NoiseStatistics
from cacc_platoon.theory.noise_interval import rho_from_snr_db

_REQUIREMENT_MISSED = 3
_DURATION = 200.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of `platoon design`."""
    question = parser.add_argument_group("question")
    ratio = question.add_mutually_exclusive_group(required=True)
    ratio.add_argument("--rho", type=float, help="signal-to-noise ratio, linear, > 1")
    ratio.add_argument("--snr-db", type=float, help="signal-to-noise ratio [dB], > 0")
    question.add_argument(
        "--tau-max", "--tau0", type=float, required=True, help="largest actuation lag tau0 [s]"
    )
    question.add_argument("--period", type=float, default=0.01, help="control period [s] (0.01)")
    question.add_argument(
        "--latency", type=float, default=0.0, help="largest constant V2V latency [s] (0)"
    )
    question.add_argument(
        "--v2v-period",
        type=float,
        help="time from packet to packet [s], a multiple of the control period; all vehicles send "
        "at the same instants (one every period)",
    )
    question.add_argument(
        "--reception",
        type=float,
        default=1.0,
        help="packet reception (1); the least one where lost packets count as zero",
    )
    question.add_argument(
        "--lost",
        choices=("zero", "hold"),
        default="zero",
        help="what a lost packet counts as: zero, or the last one is held (zero)",
    )
    design = parser.add_argument_group("a design; all four are certified, some are kept")
    design.add_argument(
        "--k-a", "--ka", type=float, help="gain on the communicated acceleration [-]"
    )
    design.add_argument("--time-headway", "--headway", type=float, help="time headway [s]")
    design.add_argument("--k-v", "--kv", type=float, help="gain on the velocity error [1/s]")
    design.add_argument("--k-p", "--kp", type=float, help="gain on the spacing error [1/s^2]")
    design.add_argument(
        "--k-effective", type=float, help="certify for this k_a E[w] at tau_max only, not the worst"
    )
    design.add_argument(
        "--chance",
        type=float,
        help="give the headway at which a link whose noise is drawn once amplifies with this "
        "probability, in continuous time",
    )
    limits = parser.add_argument_group(
        "what designs must keep to, together with period, latency and reception"
    )
    limits.add_argument("--max-headway", type=float, help="longest headway [s] (2.5 tau_max)")
    limits.add_argument(
        "--max-linf", type=float, help="largest L-infinity gain of the mean hop, every lag, >= 1"
    )
    limits.add_argument(
        "--min-gap",
        type=float,
        help="least gap of 12 followers over all brakings of the leader [m], in the mean and in "
        "continuous time: latency, V2V period and held packets left out",
    )
    limits.add_argument("--braking", type=float, default=8.0, help="its deceleration [m/s^2] (8)")
    limits.add_argument("--speed", type=float, default=25.0, help="the speed before it [m/s] (25)")
    limits.add_argument(
        "--standstill-gap", type=float, default=5.0, help="gap at rest, d less a length [m] (5)"
    )
    limits.add_argument("--max-time-constant", type=float, help="slowest mode allowed [s]")
    limits.add_argument(
        "--recommend", action="store_true", help="recommend designs although one is given"
    )
    more = parser.add_argument_group("extensions")
    more.add_argument(
        "--predecessors", type=int, default=1, help="vehicles ahead that are received (1)"
    )
    more.add_argument(
        "--human",
        nargs=4,
        type=float,
        metavar=("K_V", "K_P", "HEADWAY", "DELAY"),
        help="drivers of all other vehicles [1/s, 1/s^2, s, s]: least share of connected ones",
    )
    output = parser.add_argument_group("output")
    output.add_argument("--json", action="store_true", help="print one JSON object")
    output.add_argument("--explain", action="store_true", help="print formulas with their numbers")
    output.add_argument("--plot", type=Path, metavar="DIR", help="save pictures, SVG and PNG")
    output.add_argument("--write", type=Path, metavar="FILE", help="write a scenario to run")
    output.add_argument(
        "--pick",
        choices=("paper", "shortest", "robust", "balanced"),
        default="balanced",
        help="recommended design that --write and --plot take (balanced)",
    )
    output.add_argument(
        "--check",
        action="store_true",
        help="exit code 3 when the given design misses anything asked for",
    )


def run(args: argparse.Namespace) -> int:
    """Answer the question; see `add_arguments`."""
    question = _question(args)
    _check_output(args)
    data, found = answer(question)
    explanation = _explanation(question, found, args.pick) if args.explain else []
    if args.json:
        if explanation:
            data["explanation"] = explanation
        print(json.dumps(data, indent=2, allow_nan=False))
    else:
        print(render(data))
        if explanation:
            print("\n" + "\n".join(explanation))
    if args.plot is not None:
        chosen = _chosen(question, found, args.pick)
        files = save_design_figures(
            args.plot,
            chosen,
            question.rho,
            question.tau_max,
            k_effective=question.k_effective,
            requirements=question.requirements,
            recommendation=found,
        )
        print(f"{len(files)} pictures in {args.plot}", file=sys.stderr)
    if args.write is not None:
        _write(args.write, question, _chosen(question, found, args.pick))
    return _REQUIREMENT_MISSED if args.check and data["unmet"] else 0


def _check_output(args: argparse.Namespace) -> None:
    """Say what cannot be written before anything is computed."""
    path = args.write
    if path is None:
        return
    if path.exists():
        raise DesignError(f"--write {path} exists: it would be overwritten. Choose another name.")
    if not path.parent.is_dir():
        raise DesignError(
            f"--write {path} has no folder {path.parent}: the design cannot be saved. Make the "
            "folder or choose another place."
        )
    if args.predecessors != 1:
        raise DesignError(
            f"--write with --predecessors {args.predecessors} has no scenario: the vehicles "
            "receive from one predecessor. Leave out --write."
        )


def _question(args: argparse.Namespace) -> Question:
    rho = rho_from_snr_db(args.snr_db) if args.rho is None else args.rho
    numbers = {
        f"--{name.replace('_', '-')}": value
        for name, value in vars(args).items()
        if isinstance(value, float)
    }
    for flag, value in numbers.items():
        if not math.isfinite(value):
            raise DesignError(
                f"{flag} {value} is not a finite number: nothing can be computed. Give a number."
            )
    for flag, value, low, high in (("rho", rho, 0.0, 1e15), ("tau-max", args.tau_max, 1e-6, 1e6)):
        if 0.0 < value < low or value > high:
            raise DesignError(
                f"--{flag} {value:g} is not from {low:g} to {high:g}: its squares are no numbers "
                "to compute with. Give one in between."
            )
    _check_range(args)
    requirements = Requirements(
        period=args.period,
        latency=args.latency,
        reception=args.reception,
        hold=args.lost == "hold",
        v2v_period=args.v2v_period,
        min_gap=args.min_gap,
        braking=args.braking,
        speed=args.speed,
        standstill_gap=args.standstill_gap,
        max_headway=args.max_headway,
        max_linf=args.max_linf,
        max_time_constant=args.max_time_constant,
        k_a=args.k_a,
        time_headway=args.time_headway,
    )
    bits = V2V().bit_probabilities
    complete = None not in (args.k_a, args.time_headway, args.k_v, args.k_p)
    parts = {args.k_v, args.k_p, args.k_effective, args.chance}
    if not complete and (args.check or parts != {None}):
        raise DesignError(
            "--k-v, --k-p, --k-effective, --chance and --check need a whole design: half of one "
            "has no certificate. Give --k-a, --time-headway, --k-v and --k-p, or none."
        )
    question = Question(
        rho,
        args.tau_max,
        requirements,
        k_v=args.k_v,
        k_p=args.k_p,
        k_effective=args.k_effective,
        noise=_noise(rho, bits, args.period),
        bit_probabilities=bits,
        chance=args.chance,
        recommend=args.recommend or not complete,
        human=None if args.human is None else HumanDriver(*args.human),
    )
    return question.for_predecessors(args.predecessors)


def _check_range(args: argparse.Namespace) -> None:
    """Refuse what overflows or vanishes in squares and ratios; what is below 0 is refused later."""
    names = ("time_headway", "k_a", "k_v", "k_p", "period", "latency", "v2v_period", "speed")
    for name in (*names, "braking", "standstill_gap", "max_headway"):
        value = getattr(args, name)
        if value is not None and (0.0 < value < 1e-12 or value > 1e9):
            raise DesignError(
                f"--{name.replace('_', '-')} {value:g} is not from 1e-12 to 1e9: nothing can be "
                "computed with it. Give one in between."
            )


def _noise(rho: float, bits: tuple[float, ...], period: float) -> NoiseStatistics:
    """Take mean and variance of the default bit channel, redrawn every period."""
    if not rho > 1:
        return NoiseStatistics()  # refused in words by the answer
    return NoiseStatistics(expected_factor(rho, bits), factor_variance(rho, bits), period)


def _chosen(question: Question, found: Recommendation | None, name: str) -> Gains:
    """Return the given design, else the recommended one of that name."""
    if question.gains is not None:
        return question.gains
    if found is not None:
        return found[name].gains
    return paper_design(question.rho, question.tau_max, reception=question.reception)


def _explanation(question: Question, found: Recommendation | None, name: str) -> list[str]:
    gains = _chosen(question, found, name)
    title = "the given design" if question.gains else f"the design named {name}"
    return [
        *explain_bounds(question.rho, question.tau_max, question.k_a, reception=question.reception),
        f"For {title}: " + ", ".join(f"{key} = {x:.6g}" for key, x in gains._asdict().items()),
        *explain_design(gains, question.rho, question.tau_max, reception=question.reception),
    ]


def _channel(ask: Requirements) -> dict[str, float | str]:
    """Return the packets that are asked for as parameters of a scenario."""
    packets: dict[str, float | str] = {"v2v.latency": ask.latency}
    if ask.v2v_period is not None:
        packets["v2v.period"] = ask.v2v_period
    if ask.reception < 1.0:
        packets["v2v.loss"] = 1.0 - ask.reception
        packets["v2v.reception"] = "hold" if ask.hold else "zero"
    return packets


def _write(path: Path, question: Question, gains: Gains) -> None:
    """Write the design as a scenario that `platoon run` takes."""
    step = question.requirements.period
    scenario = Scenario.from_values(
        {
            "vehicle.tau": question.tau_max,
            "vehicle.tau_max": question.tau_max,
            **{f"controller.{name}": value for name, value in gains._asdict().items()},
            "v2v.rho": question.rho,
            **_channel(question.requirements),
            "run.step": step,
            "run.duration": round(math.ceil(_DURATION / step) * step, 9),
        },
        source=str(path),
    )
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(format_scenario(scenario))
    except OSError as error:
        raise DesignError(
            f"--write {path} cannot be written ({error.strerror}): the design is not saved. "
            "Choose another place."
        ) from error
    print(f"scenario in {path}", file=sys.stderr)
