"""What a page makes of our notation, and what it leaves alone."""

import html
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cacc_platoon.notation import as_html, as_text
from cacc_platoon.scenario.table import TABLE

MATHEMATICS = {
    "d h_lb/d k_a": "d h<sub>lb</sub>/d k<sub>a</sub>",
    "sup|delta_i/delta_(i-1)|": "sup|δ<sub>i</sub>/δ<sub>i−1</sub>|",
    "0.0e+00": "0",
    "tau0": "τ<sub>0</sub>",
    "tau_0 k_p": "τ<sub>0</sub> k<sub>p</sub>",
    "every tau in (0, tau0]": "every τ in (0, τ<sub>0</sub>]",
    "1 - 1/rho <= w <= 1 + 1/rho": "1 − 1/ρ ≤ w ≤ 1 + 1/ρ",
    "sup|H(jw)| <= 1": "sup|H(jω)| ≤ 1",
    "sup|H(jw; tau_0)|": "sup|H(jω; τ<sub>0</sub>)|",
    "sup|H_1...H_N| > 1": "sup|H<sub>1</sub>…H<sub>N</sub>| &gt; 1",
    "B + 2 tau sqrt(C) >= 0": "B + 2 τ √C ≥ 0",
    "Q + sqrt(2 k_p X)": "Q + √(2 k<sub>p</sub> X)",
    "sqrt(2 k_p (X + 1))": "√(2 k<sub>p</sub> (X + 1))",
    "delta_i = H delta_{i-1}": "δ<sub>i</sub> = H δ<sub>i−1</sub>",
    "max|a_(i-1)|": "max|a<sub>i−1</sub>|",
    "1.2 * 1.16^(i-1) s^2": "1.2 · 1.16<sup>i−1</sup> s²",
    "2*0.5*(1 - 0.4)": "2·0.5·(1 − 0.4)",
    "|delta_i|_2 <= 3 s^2": "‖δ<sub>i</sub>‖<sub>2</sub> ≤ 3 s²",
    "E|a_i(jw)|^2": "E|a<sub>i</sub>(jω)|²",
    "2^(1-n)/rho": "2<sup>1−n</sup>/ρ",
    "m/s^2, 1/s^3, m s^0.5, 1.5^-1": "m/s², 1/s³, m s<sup>0.5</sup>, 1.5<sup>−1</sup>",
    "k_a* = 0.3": "k<sub>a</sub>* = 0.3",
    "k~_a in I": "k̃<sub>a</sub> in I",
    "h_w > h_lb(k_a)": "h<sub>w</sub> &gt; h<sub>lb</sub>(k<sub>a</sub>)",
    "S = S1 and S2, a1 <= a2": "S = S<sub>1</sub> and S<sub>2</sub>, a<sub>1</sub> ≤ a<sub>2</sub>",
    "c_T = 6.43e-05, at 1e-09": "c<sub>T</sub> = 6.43·10<sup>−5</sup>, at 10<sup>−9</sup>",
    "L2, L-infinity, H-infinity": "L<sub>2</sub>, L<sub>∞</sub>, H<sub>∞</sub>",
    "c_T = inf, margin -inf": "c<sub>T</sub> = ∞, margin −∞",
    "link 1 -> 2": "link 1 → 2",
    "E[w_i]": "E[w<sub>i</sub>]",
    "gamma = k_v + h_w k_p.": "γ = k<sub>v</sub> + h<sub>w</sub> k<sub>p</sub>.",
    "max_t|delta|": "max<sub>t</sub>|δ|",
    "a < b & c": "a &lt; b &amp; c",
}
CODE = (
    "v2v.rho",
    "controller.k_a=0.5",
    "vehicle.tau_max, vehicle.tau",
    "vehicle_3.v2v.rho",
    "tau_max and time_headway",
    "v2v.bit_probabilities",
    "platoon design --rho 5 --tau0 0.5 --k-a 1",
    "/platoon/tau/rho",
    "./rho/tau",
    "/platoon/vehicle_3/v2v/accel",
    "vehicle_4/noise_relay",
    "runs/tau/k_a",
    "k_a.json",
    "my_laws:tau",
    "record.parts with record:=DIR",
    "per_node",
    "a_inf.json, infimum",
    "rho5 and k_a_b",
    "a-b and 12e45",
    "-",
)


@pytest.mark.parametrize("text", MATHEMATICS)
def test_mathematics(text):
    assert as_html(text) == MATHEMATICS[text]
    assert as_html(f"({text})") == f"({MATHEMATICS[text]})"


@pytest.mark.parametrize("text", CODE)
def test_code_stays(text):
    assert as_html(text) == as_text(text) == text


@pytest.mark.parametrize("name", TABLE)
def test_names_of_parameters_stay(name):
    assert as_html(f"Lower {name} or raise vehicle_2.{name}.") == (
        f"Lower {name} or raise vehicle_2.{name}."
    )


def test_a_code_span_is_shown_as_code():
    assert as_html("try `design --rho 5 <tau>`, rho") == (
        "try <code>design --rho 5 &lt;tau&gt;</code>, ρ"
    )
    assert as_text("try `design --rho 5 <tau>`, rho") == "try design --rho 5 <tau>, ρ"


def test_text_has_no_markup():
    assert as_text("|H(jw)| at tau_0 in m/s^2, 2^(1-n), a_{i-1}, m s^0.5, <b>") == (
        "|H(jω)| at τ₀ in m/s², 2¹⁻ⁿ, a_(i−1), m s^0.5, <b>"
    )


@given(st.text(alphabet="<>&\"'`abk_0123tau^(){}|*-. \n=/:wjsqrt", max_size=40))
def test_any_text_is_escaped_and_only_marked_up(text):
    shown = as_html(text)
    assert not re.search(r"<(?!/?(?:sub|sup|code)>)", shown)
    bare = re.sub(r"</?(?:sub|sup|code)>", "", shown)
    assert html.escape(html.unescape(bare)) == bare
    for tag in ("sub", "sup", "code"):
        assert shown.count(f"<{tag}>") == shown.count(f"</{tag}>")
