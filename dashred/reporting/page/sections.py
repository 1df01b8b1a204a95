"""The sections of the report, each from the findings alone."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.formatting import number, percent, pretty, rounded
from dashred.core.units import NONE, shown
from dashred.reporting.page.equations import equations_html
from dashred.reporting.page.parts import paragraphs, section, table
from dashred.reporting.text.improvement import reconstructed, unresolved, worth
from dashred.reporting.text.method_names import AT_SENSORS, method_name
from dashred.reporting.text.verdict import (
    alternative_in_words,
    certainty,
    consequences,
    places,
    sentence,
    unknowable,
)

PROOFS = {
    "test_sensors": "test sensors",
    "heldout_time": "held-out time",
    "heldout_restarted": "held-out time, from a state fitted just before it",
    "heldout_episode": "an episode held out whole",
}
ERRORS = (
    "RMSE in standard deviations of what each sensor read: 0 is perfect, 1 as bad as its mean. "
    "Nothing was fitted to any of this."
)
CAUSES = {
    "missing-term": "a missing term",
    "nothing-missing": "nothing missing",
    "parameter": "a changed parameter",
    "initial-condition": "a start outside of its prior",
    "sensor-fault": "a sensor at fault",
    "outside-library": "something outside the library",
}
# What is left that is larger than the noise by less than this factor is noise.
SAME = 1.02
# A cause less probable than this is one of the others.
RARE = 0.005


def where_it_acts(findings: Mapping[str, Any], figures: str) -> str:
    """In which equations, in what places, at what times and at which sensors."""
    told = places(findings["where"], findings.get("units", NONE)) if findings["terms"] else []
    return section("Where", paragraphs(told), figures)


def the_law(findings: Mapping[str, Any], figures: str) -> str:
    """The equations with what was put in, its size, and how sure it is."""
    terms = findings["terms"] or []
    if not terms:
        others = _alternatives(findings["alternatives"] or [])
        return section("How sure", paragraphs(_weighed(findings)), others, figures)
    return section(
        "What",
        paragraphs(["Highlighted: what is put into the simulation's own equations."], "note"),
        equations_html(findings),
        paragraphs(consequences(findings)),
        _terms(terms),
        "<h3>How sure</h3>",
        paragraphs([*_weighed(findings), *certainty(findings)]),
        _alternatives(findings["alternatives"] or []),
        figures,
    )


def proof(findings: Mapping[str, Any], figures: str) -> str:
    """Errors before and after, where nothing was fitted."""
    fit = findings["fit"]
    kinds = {
        kind: name
        for kind, name in PROOFS.items()
        if any((fit.get(kind) or {}).get(method) is not None for method in AT_SENSORS)
    }
    known = {method: [fit[kind].get(method) for kind in kinds] for method in AT_SENSORS}
    rows = [
        [method_name(method), *("–" if value is None else f"{value:.3g}" for value in values)]
        for method, values in known.items()
        if any(value is not None for value in values)
    ]
    heads = ["", *kinds.values()]
    errors = table(heads, rows, numbers=range(1, len(heads))) if rows else ""
    note = paragraphs([ERRORS], "note") if rows else ""
    told = paragraphs([*worth(fit), *reconstructed(findings)]) if rows else ""
    return section("Before and after, on data that no fit has seen", told, errors, note, figures)


def forecast(findings: Mapping[str, Any], figures: str) -> str:
    """What the corrected simulation foretells, and how far to trust it."""
    if not figures:
        return ""
    errors = findings["fit"]["heldout_time"]
    before, after = errors.get("before_refit"), errors.get("after")
    told = ["The corrected simulation runs on freely from where the recording ends."]
    if before is not None and after is not None:
        told.append(
            "How far to trust it, the held-out time tells, which was foretold in the same way: "
            f"there its error is {after:.3g} of a standard deviation, without the law {before:.3g}."
        )
    if inputs := findings["input"]["config"].get("system", {}).get("inputs"):
        measured = ", ".join(inputs)
        told.append(
            f"Where inputs ({measured}) were not measured that far, the last value is held."
        )
    return section("Forecast, beyond the recording", paragraphs([" ".join(told)]), figures)


def unexplained(findings: Mapping[str, Any]) -> str:
    """What remains of the misfit when the best law is put in."""
    fit, lines = findings["fit"], []
    if (share := fit["unexplained"]) is not None:
        times = 1 / math.sqrt(max(1 - share, 1e-12))
        lines.append(
            "What the corrected simulation misses is no larger than the sensors' own noise."
            if times < SAME
            else "What the corrected simulation misses at the sensors is "
            f"{number(float(f'{times:.2g}'))} times as large as their own noise, as it was stated "
            "or shows in the traces: either the law is not the whole story, or there is more noise."
        )
    correlation = fit["noise_correlation"]
    if correlation is not None and abs(correlation) >= 0.1:
        lines.append(
            "What is left is not independent from sample to sample: "
            f"neighbouring samples correlate by {number(float(f'{correlation:.2g}'))}."
        )
    lines += unresolved(fit)
    outside = [c for c in findings["causes"] or [] if c["kind"] == "outside-library"]
    lines += [sentence(c["says"]) for c in outside if "says" in c]
    return section("What stays unexplained", paragraphs(lines))


def cannot_know(findings: Mapping[str, Any]) -> str:
    """What it costs that the simulator is known by snapshots alone."""
    title, *lines = unknowable(findings) or [""]
    return section(title.rstrip(":"), paragraphs(lines)) if lines else ""


def _weighed(findings: Mapping[str, Any]) -> list[str]:
    """The kinds of causes with their probabilities, where more than one was weighed."""
    known: dict[str, float] = {}
    for cause in findings["causes"] or []:
        if cause["kind"] in CAUSES and cause["probability"] is not None:
            known.setdefault(cause["kind"], cause["probability"])
    told = [f"{CAUSES[kind]} {percent(p)}" for kind, p in known.items() if p >= RARE]
    if len(told) < len(known):
        told.append("others less than 1 %")
    several = "; more than one may be true" if sum(known.values()) > 1 + RARE else ""
    return [f"Of the causes that were weighed: {', '.join(told)}{several}."] if told else []


def _terms(terms: Sequence[Mapping[str, Any]]) -> str:
    rows, with_unit = [], any("unit" in term for term in terms)
    for term in terms:
        value, std = rounded(term["coefficient"], term["std"])
        low, high = (rounded(end, term["std"])[0] for end in term["ci95"])
        where = "parameter" if term["equation"] is None else f"equation of {term['equation']}"
        if term["equation"] is None:
            value = f"{number(term['from'])} → {rounded(term['to'], term['std'])[0]}"
        unit = [shown(term["unit"]) if "unit" in term else "–"] if with_unit else []
        included = percent(term["inclusion"])
        cells = [where, pretty(term["term"]), value, std, f"{low} … {high}", *unit, included]
        rows.append(cells)
    heads = ["where", "term", "coefficient", "std", "95 % interval"]
    heads += [*(["unit"] if with_unit else []), "probability"]
    return table(heads, rows, numbers={2, 3, 4, len(heads) - 1})


def _alternatives(alternatives: Sequence[Mapping[str, Any]]) -> str:
    if not alternatives:
        return ""
    rows = [
        [
            alternative_in_words(other),
            number(float(f"{other['delta_bic']:.3g}")),
            "yes" if other["rival"] else "no",
            "yes" if other["same_as_best"] else "no",
        ]
        for other in alternatives
    ]
    heads = ["other explanation", "ΔBIC", "fits about as well", "same at these sensors"]
    return table(heads, rows, numbers={1})
