"""The contents of the report's sections, from the findings."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from dashred.core.findings.cause_schema import NONE_OF_THESE
from dashred.core.findings.methods import AT_SENSORS, method_label
from dashred.core.formatting import number, percent, pretty, rounded, sentence
from dashred.core.units import format_unit
from dashred.reporting.page.views import Table
from dashred.reporting.text.causes import NOISE_RATIO, noise_ratio
from dashred.reporting.text.improvement import count_text, resolution_warning
from dashred.reporting.text.laws import alternative_text
from dashred.reporting.text.support import has_probabilities

HELD_OUT = {
    "test_sensors": "test sensors",
    "heldout_time": "held-out time",
    "heldout_restarted": "held-out time, from a state fitted just before it",
    "heldout_episode": "held-out episode",
}
CAUSES = {
    "missing-term": "a missing term",
    "nothing-missing": "nothing missing",
    "parameter": "a wrong parameter",
    "initial-condition": "a start outside its prior",
    "sensor-fault": "a faulty sensor",
    "outside-library": "an effect outside the library",
}
# A smaller correlation of the residuals is not reported.
MIN_CORRELATION = 0.1
# Less probable causes are listed together.
MIN_PROBABILITY = 0.005


def terms_table(findings: Mapping[str, Any]) -> Table:
    """Return the terms of the law with their coefficients, intervals and probabilities."""
    terms = findings["terms"] or []
    lets = findings["input"]["config"].get("system", {}).get("let", {})
    rows, with_unit = [], any("unit" in term for term in terms)
    is_sure = has_probabilities(findings)
    for term in terms:
        value, std = rounded(term["coefficient"], term["std"])
        low, high = (rounded(end, term["std"])[0] for end in term["ci95"])
        where = _place(term["equation"], lets)
        if term["equation"] is None:
            value = f"{number(term['from'])} → {rounded(term['to'], term['std'])[0]}"
        unit = [format_unit(term["unit"]) if "unit" in term else "–"] if with_unit else []
        included = [percent(term["inclusion"])] if is_sure else []
        cells = [where, pretty(term["term"]), value, std, f"{low} … {high}", *unit, *included]
        rows.append(cells)
    heads = ["where", "term", "coefficient", "std", "95 % interval"]
    heads += [*(["unit"] if with_unit else []), *(["probability"] if is_sure else [])]
    return Table(heads, rows, numbers={2, 3, 4, *([len(heads) - 1] if is_sure else [])})


def _place(equation: str | None, lets: Collection[str]) -> str:
    if equation is None:
        return "parameter"
    return f"let {equation}" if equation in lets else f"equation of {equation}"


def alternatives_table(others: Sequence[Mapping[str, Any]]) -> Table:
    """Return the alternative laws, compared with the best one."""
    rows = [
        [
            alternative_text(other),
            number(float(f"{other['delta_bic']:.3g}")),
            "yes" if other["rival"] else "no",
            "yes" if other["same_as_best"] else "no",
        ]
        for other in others
    ]
    heads = [
        "other explanation",
        "ΔBIC",
        "fits about as well",
        "indistinguishable at these sensors",
    ]
    return Table(heads, rows, numbers={1})


def cause_probabilities(findings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the probability of each kind of cause, and whether several may be true.

    There are none that held-out data do not confirm.
    """
    known: dict[str, float] = {}
    for cause in (findings["causes"] or []) if has_probabilities(findings) else []:
        if cause["kind"] in CAUSES and cause["probability"] is not None:
            known.setdefault(cause["kind"], cause["probability"])
    none = [f"none of these {percent(NONE_OF_THESE)}"] if known else []
    listed = [f"{CAUSES[kind]} {percent(p)}" for kind, p in known.items() if p >= MIN_PROBABILITY]
    if len(listed) < len(known):
        listed.append("others less than 1 %")
    several = sum(known.values()) > 1 - NONE_OF_THESE + MIN_PROBABILITY
    return {"causes": [*listed, *none], "several": several}


def errors_table(fit: Mapping[str, Any]) -> Table:
    """Return the errors of all methods on held-out data."""
    kinds = {
        kind: name
        for kind, name in HELD_OUT.items()
        if any((fit.get(kind) or {}).get(method) is not None for method in AT_SENSORS)
    }
    known = {method: [fit[kind].get(method) for kind in kinds] for method in AT_SENSORS}
    rows = [
        [method_label(method), *("–" if value is None else f"{value:.3g}" for value in values)]
        for method, values in known.items()
        if any(value is not None for value in values)
    ]
    samples = fit.get("held_out_samples", {})
    heads = ["", *(f"{name}{count_text(samples.get(kind))}" for kind, name in kinds.items())]
    return Table(heads, rows, numbers=range(1, len(heads)))


def unexplained(findings: Mapping[str, Any]) -> dict[str, Any]:
    """Compare the residuals of the corrected simulation with the noise."""
    fit = findings["fit"]
    share, correlation = fit["unexplained"], fit["noise_correlation"]
    ratio = None if share is None else noise_ratio(share, fit["chi2"])
    correlated = correlation is not None and abs(correlation) >= MIN_CORRELATION
    outside = [c for c in findings["causes"] or [] if c["kind"] == "outside-library"]
    return {
        "as_noise": ratio is not None and ratio < NOISE_RATIO,
        "times": None if ratio is None else number(float(f"{ratio:.2g}")),
        "correlation": number(float(f"{correlation:.2g}")) if correlated else None,
        "others": [
            *resolution_warning(fit),
            *(sentence(c["says"]) for c in outside if "says" in c),
        ],
    }
