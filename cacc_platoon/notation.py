"""Mathematics as people write it: from the notation of terminals and JSON to that of a page.

`tau_0`, `|H(jw)| <= 1` and `m/s^2` become τ with a subscript, |H(jω)| ≤ 1 and m/s². What is code
stays: `code spans`, options, paths, dotted names and module:Class.
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from typing import NamedTuple

__all__ = ["as_html", "as_text"]

_GREEK = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "delta": "δ",
    "Delta": "Δ",
    "eta": "η",
    "theta": "θ",
    "kappa": "κ",
    "lambda": "λ",
    "rho": "ρ",
    "sigma": "σ",
    "tau": "τ",
    "phi": "φ",
    "Phi": "Φ",
    "omega": "ω",
    "Gam": "Γ",
}
_OPERATORS = {"<=": "≤", ">=": "≥", "!=": "≠", "->": "→", "...": "…"}
_NAMES = "|".join(sorted(_GREEK, key=len, reverse=True))
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SUPERSCRIPTS = str.maketrans("0123456789−+in", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺ⁱⁿ")


class _Rule(NamedTuple):
    """What is recognised, and what a page has for it."""

    pattern: str
    write: Callable[[re.Match[str]], str]


def _script(text: str) -> str:
    """Write the inside of a subscript or superscript."""
    return html.escape(text.strip("{}()").replace("-", "−"))


def _name(word: str) -> str:
    return _GREEK.get(word, word)


def _power(number: str, exponent: str) -> str:
    if float(number) == 0.0 or int(exponent) == 0:
        return "0" if float(number) == 0.0 else number
    sign = "−" if exponent[0] == "-" else ""
    power = f"10<sup>{sign}{exponent[1:].lstrip('0') or '0'}</sup>"
    return power if number == "1" else f"{number}·{power}"


_RULES = {
    "span": _Rule(r"`[^`]+`", lambda m: f"<code>{html.escape(m[0][1:-1])}</code>"),
    "code": _Rule(
        r"(?<![\w-])--[A-Za-z][\w-]*"  # an option
        r"|(?<![\w)\]|}/.*])\.{0,2}/[A-Za-z_][\w/.]*"  # a path
        rf"|(?<!\w)(?!(?:{_NAMES}|(?:{_NAMES}|[A-Za-z])_(?:\w|lb))/)"  # a relative one, or a unit
        r"[A-Za-z]\w+/[A-Za-z_][\w/.]*"
        r"|(?<![\w.])[A-Za-z_]\w*(?:[.:][A-Za-z_]\w*)+",  # a dotted name, module:Class
        lambda m: html.escape(m[0]),
    ),
    "norm": _Rule(
        r"\|(?P<inside>[^|\s]+)\|_(?P<which>2|inf)\b",
        lambda m: f"‖{as_html(m['inside'])}‖<sub>{'2' if m['which'] == '2' else '∞'}</sub>",
    ),
    "space": _Rule(
        r"\b(?P<letter>[LH])(?P<order>2|-infinity)\b",
        lambda m: f"{m['letter']}<sub>{'2' if m['order'] == '2' else '∞'}</sub>",
    ),
    "root": _Rule(
        r"\bsqrt\((?P<under>[^()]*(?:\([^()]*\)[^()]*)*)\)",
        lambda m: (
            f"√{as_html(m['under'])}" if m["under"].isalnum() else f"√({as_html(m['under'])})"
        ),
    ),
    "tilde": _Rule(r"(?<!\w)k~_?a(?!\w)|(?<!\w)k_a~", lambda _: "k̃<sub>a</sub>"),
    "indexed": _Rule(
        rf"(?<!\w)(?<!\w\.)(?P<base>{_NAMES}|max|min|sup|[A-Za-z])"
        r"_(?P<index>\{[^{}]*\}|\([^()]*\)|lb|[A-Za-z]|\d+)(?!\w)",
        lambda m: f"{_name(m['base'])}<sub>{_script(m['index'])}</sub>",
    ),
    "numbered": _Rule(
        r"(?<![\w.])(?P<stem>tau0|[abrSL][012])(?!\w)(?!\.\w)",
        lambda m: f"{_name(m['stem'][:-1])}<sub>{m['stem'][-1]}</sub>",
    ),
    "frequency": _Rule(r"(?<=\()jw\b", lambda _: "jω"),
    "greek": _Rule(rf"(?<![\w.])(?:{_NAMES})(?!\w)", lambda m: _name(m[0])),
    "raised": _Rule(
        r"\^(?P<power>\([^()]*\)|\{[^{}]*\}|-?\d+(?:\.\d+)?|[A-Za-z](?!\w))",
        lambda m: {"2": "²", "3": "³"}.get(m["power"], f"<sup>{_script(m['power'])}</sup>"),
    ),
    "float": _Rule(
        r"(?<![\w.])(?P<number>\d+(?:\.\d+)?)e(?P<exponent>[+-]\d+)(?!\w)",
        lambda m: _power(m["number"], m["exponent"]),
    ),
    "endless": _Rule(r"(?<![\w.-])-?inf(?![\w.])", lambda m: m[0].replace("-", "−")[:-3] + "∞"),
    "operator": _Rule(r"<=|>=|!=|(?<!-)->|(?<=\w)\.\.\.(?=\w)", lambda m: _OPERATORS[m[0]]),
    "times": _Rule(r"(?<=\S)\*(?=[\w(|])| \* ", lambda m: m[0].replace("*", "·")),
    "minus": _Rule(r"(?<=[\w)\]}|]) - (?=[\w(|])", lambda _: " − "),
}
_ANY = re.compile("|".join(f"(?P<{name}>{rule.pattern})" for name, rule in _RULES.items()))


def as_html(text: str) -> str:
    """Return text as a page shows it: escaped, its mathematics with subscripts and symbols.

    Examples
    --------
    >>> as_html("tau_0 and |H(jw)| <= 1")
    'τ<sub>0</sub> and |H(jω)| ≤ 1'
    >>> as_html("lower v2v.rho or tau_max, see `design --rho 5`")
    'lower v2v.rho or tau_max, see <code>design --rho 5</code>'
    """
    parts, end = [], 0
    for match in _ANY.finditer(text):
        parts += [html.escape(text[end : match.start()]), _written(match)]
        end = match.end()
    return "".join([*parts, html.escape(text[end:])])


def as_text(text: str) -> str:
    """Return the same without markup, for titles and for who listens to a page.

    Examples
    --------
    >>> as_text("|H(jw)| at h_w = 0.95 s, m/s^2"), as_text("tau_0")
    ('|H(jω)| at h_w = 0.95 s, m/s²', 'τ₀')
    """
    marked = re.sub(r"<sub>(.*?)</sub>", lambda m: _turned(m[1], _SUBSCRIPTS, "_"), as_html(text))
    marked = re.sub(r"<sup>(.*?)</sup>", lambda m: _turned(m[1], _SUPERSCRIPTS, "^"), marked)
    return html.unescape(re.sub(r"</?code>", "", marked))


def _written(match: re.Match[str]) -> str:
    """Write what a rule found, which is the outermost of the groups that matched."""
    name = next(name for name in _RULES if match[name] is not None)
    return _RULES[name].write(match)


def _turned(inside: str, letters: dict[int, int], mark: str) -> str:
    """Raise or lower letters where Unicode has them all, else mark them as ASCII does."""
    turned = inside.translate(letters)
    if all(ord(letter) in letters for letter in inside):
        return turned
    return mark + (inside if inside.replace(".", "").isalnum() else f"({inside})")
