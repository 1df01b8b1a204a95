"""The findings in a few sentences: the law, its rivals, its location, and its improvement."""

from collections.abc import Mapping
from typing import Any

from dashred.core.formatting import joined, number, parenthesize_sum, percent, pretty, with_error
from dashred.core.units import NO_UNITS, with_unit
from dashred.reporting.text.causes import fault_causes
from dashred.reporting.text.improvement import (
    UNTESTED,
    assimilation_gains,
    contradictions,
    forecast_limits,
    improvements,
    is_confirmed,
    is_unsupported,
    names_nearest_law,
    resolution_warning,
)
from dashred.reporting.text.regions import bounds
from dashred.reporting.text.shared_parameters import shared_parameters
from dashred.reporting.text.sources import source_text

VERDICTS = {
    "missing-term": "a term is missing from the simulation",
    "nothing-missing": "nothing is missing from the simulation",
    "parameter": "a parameter of the simulation has a wrong value",
    "initial-condition": "the simulation starts from the wrong state",
    "sensor-fault": "a sensor is faulty, not the simulation",
    "unresolved-numerics": "the simulation is not resolved, so its physics cannot be assessed",
    "outside-library": "no law of a few terms of the library explains the recording",
    "ambiguous": "several explanations fit about equally well",
    "not-converged": "the search did not converge",
    "mismatch": "the recording differs from the simulation, and snapshots alone cannot show why",
    "no-mismatch-seen": "the recording agrees with the simulation's snapshots",
    "unconfirmed": "an explanation fits the recording, but the held-out data contradict it",
}
# The meaning of missing-term for more than one.
SEVERAL_TERMS = "terms are missing from the simulation"
# The meaning of nothing-missing if the simulation agrees with fitted parameters.
NOTHING_BESIDE_PARAMETERS = "the equations with the fitted parameters explain the recording"
PARTS = {
    "H": "H, the energy",
    "J": "J, the exchange of energy",
    "R": "R, the dissipation",
    "G": "G, the input",
    None: "no single part of the structure",
}
# Of more terms than a few, the smallest law that explains nearly all is reported, too.
FEW, NEARLY = 3, 0.95
# A less probable cause is not reported.
LIKELY = 0.05
LIMITS = "Limits of this analysis"
SUGGESTED = "Suggested, but not confirmed"


def verdict_lines(findings: Mapping[str, Any]) -> list[str]:
    """Return the verdict and its details, one or two sentences a line; empty without a verdict."""
    verdict = findings["verdict"]
    if verdict is None:
        return []
    head = f"Verdict: {verdict}: {meaning(findings)}."
    unknown = limits(findings)
    body = [
        *contradictions(findings),
        *causes(findings),
        *source(findings),
        *law(findings),
        *other_laws(findings),
        *resolution_warning(findings["fit"]),
        *location(
            findings["where"] if has_law(findings) else None, findings.get("units", NO_UNITS)
        ),
        *consequences(findings),
        *improvements(findings),
        *forecast_limits(findings),
        *assimilation_gains(findings),
        *shared_parameters(findings),
        *([f"{LIMITS}:"] if unknown else []),
        *(f"- {text}" for text in unknown),
    ]
    return [head, *(f"  {line}" for line in body)]


def meaning(findings: Mapping[str, Any]) -> str:
    """Return the meaning of the verdict in a few words."""
    verdict = findings["verdict"]
    if verdict == "nothing-missing" and findings.get("fitted_parameters"):
        return NOTHING_BESIDE_PARAMETERS
    if verdict == "missing-term" and len(findings["terms"] or ()) > 1:
        return SEVERAL_TERMS
    return VERDICTS.get(verdict, "see findings.json")


def causes(findings: Mapping[str, Any]) -> list[str]:
    """Return the texts of the reported causes."""
    told = [_says(findings, cause) for cause in _reported(findings) if "says" in cause]
    if told and not is_confirmed(findings) and not findings["terms"]:
        told[0] = f"{SUGGESTED}: {told[0]}"
    return [sentence(text) for text in told]


def _says(findings: Mapping[str, Any], cause: Mapping[str, Any]) -> str:
    """Return the text of a cause; a fault beside the nearest law is as uncertain as the law."""
    splits = findings["input"]["splits"] or {"validate": (), "test": ()}
    is_tested = cause.get("sensor") in (*splits["validate"], *splits["test"])
    beside = cause["kind"] == "sensor-fault" and names_nearest_law(findings) and not is_tested
    return f"in the nearest law, {cause['says']}" if beside else str(cause["says"])


def _reported(findings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the leading cause and the faulty sensors; if ambiguous, all probable causes."""
    known = findings["causes"] or []
    if findings["verdict"] != "ambiguous":
        return [*known[:1], *fault_causes(known[1:])]
    return [cause for cause in known if cause["probability"] >= LIKELY]


def alternative_text(alternative: Mapping[str, Any]) -> str:
    """Return the law of an alternative: ``u: 0.0249·u, u: −0.0251·u³``; ``nothing``."""
    terms = (in_symbols(term, term["region"]) for term in alternative["terms"])
    return ", ".join(terms) or "nothing"


def sentence(text: str) -> str:
    """Return the text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def located_source(findings: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the localised source of the findings, if there is one."""
    found: Mapping[str, Any] | None = (findings["where"] or {}).get("source")
    return found


def has_law(findings: Mapping[str, Any]) -> bool:
    """Return whether there are terms that do not express a localised source."""
    found = located_source(findings)
    return bool(findings["terms"]) and not (found and found["as_terms"])


def source(findings: Mapping[str, Any]) -> list[str]:
    """Return the localised source, or where the force is largest that no law explains."""
    units = findings.get("units", NO_UNITS)
    if found := located_source(findings):
        return [sentence(source_text(found, units))]
    forcing = (findings["where"] or {}).get("forcing")
    is_unexplained = any("gain" in cause for cause in _reported(findings))
    if forcing is None or not is_unexplained:
        return []
    if not forcing["peak"]:
        return _force_in_time(forcing)
    peak = " and ".join(
        f"{axis} = {with_unit(f'{place:.3g}', units.get(axis))}"
        for axis, place in zip(_axes(findings), forcing["peak"], strict=True)
    )
    return [f"The force that the simulation lacks is largest about {peak}."]


def _force_in_time(forcing: Mapping[str, Any]) -> list[str]:
    """Return in which equations a force of a system without axes acts, and when most."""
    size = {
        field: [abs(value) for value in cells[0]] for field, cells in forcing["amplitude"].items()
    }
    acting = [field for field, values in size.items() if any(values)]
    if not acting:
        return []
    largest = max(acting, key=lambda field: max(size[field]))
    when = forcing["times"][size[largest].index(max(size[largest]))]
    equations = "equation" if len(acting) == 1 else "equations"
    return [
        f"The force that the simulation lacks acts in the {equations} of {' and '.join(acting)}, "
        f"and is largest about t = {when:.4g}."
    ]


def _axes(findings: Mapping[str, Any]) -> list[str]:
    return list(findings["input"]["config"]["system"]["axes"])


def law(findings: Mapping[str, Any]) -> list[str]:
    """Return the missing terms and the wrong parameters, with their sizes."""
    terms = findings["terms"] or []
    if not has_law(findings):
        return []
    rivals = any(other["rival"] for other in findings["alternatives"] or [])
    undecided = findings["verdict"] == "ambiguous" or rivals
    guess = "As the best guess, " if undecided and terms else ""
    if names_nearest_law(findings):
        how = ", which no held-out data support," if is_unsupported(findings) else ","
        guess = f"In the nearest law{how} "
    if not is_confirmed(findings):
        guess = f"{SUGGESTED}: "
    added = [term for term in terms if term["equation"] is not None]
    missing = [term["says"] for term in added]
    if len(added) > FEW:
        # So many are listed in symbols.
        units = findings.get("units", NO_UNITS)
        listed = ", ".join(_with_bounds(term, units) for term in added)
        missing = [f"{len(added)} terms: {listed}"]
    changed = [term["says"] for term in terms if term["equation"] is None]
    lines = []
    if missing:
        lines.append(f"the simulation leaves out {'; and '.join(missing)}")
    if changed:
        noun = "a parameter has a wrong value" if len(changed) == 1 else "parameters are wrong"
        lines.append(f"{noun}: {'; and '.join(changed)}")
    lines = [f"{guess}{line}" for line in lines]
    parts = [*lines, *_hidden(findings), *_main_part(findings), *_also_supported(findings)]
    return [sentence(line) for line in [*parts, *_unsupported(findings)]]


def main_terms(findings: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """Return the smallest law that explains nearly all that many terms do; None of few terms."""
    if len(findings["terms"] or []) <= FEW:
        return None
    nearly = (law for law in findings["smaller"] or [] if law["explained"] >= NEARLY)
    return min(nearly, key=lambda law: len(law["terms"]), default=None)


def _main_part(findings: Mapping[str, Any]) -> list[str]:
    few = main_terms(findings)
    if few is None:
        return []
    left = f"{100 * (1 - few['explained']):.2g} %"
    return [f"of this, {alternative_text(few)} alone explains all but {left}"]


def _hidden(findings: Mapping[str, Any]) -> list[str]:
    """Return what the hidden state of the law follows, with its time constant and its gain."""
    hidden = findings.get("hidden_state")
    return [] if hidden is None else [hidden["says"]]


def _also_supported(findings: Mapping[str, Any]) -> list[str]:
    """Return the terms beside the law: the recording supports them, or only the fit gains."""
    others = findings.get("also_supported")
    if not others:
        return []
    listed = ", ".join(in_symbols(term, term["region"]) for term in others)
    leading = (findings["causes"] or [{}])[0]
    if not is_confirmed(findings) or {"gain", "residual"} & leading.keys():
        return [f"further terms lower the misfit, but are not confirmed: {listed}"]
    noun = "this term" if len(others) == 1 else "these terms"
    return [f"also supported: {listed}; the forecast does not need {noun}"]


def _unsupported(findings: Mapping[str, Any]) -> list[str]:
    """Return that no held-out data support the law, where this is not said otherwise."""
    is_said = names_nearest_law(findings) or not is_confirmed(findings)
    if is_said or not is_unsupported(findings):
        return []
    return ["no held-out data support this law: its error is nowhere smaller"]


def other_laws(findings: Mapping[str, Any]) -> list[str]:
    """Return the other laws that fit, and the best of those that do not."""
    others = findings["alternatives"] or []
    equal = [other for other in others if other["rival"] and other["same_as_best"]]
    rivals = [other for other in others if other["rival"] and not other["same_as_best"]]
    lines = []
    if equal:
        listed = "; ".join(map(alternative_text, equal))
        lines.append(f"At these sensors, this law cannot be distinguished from: {listed}.")
    if rivals:
        listed = "; ".join(f"{alternative_text(r)} (ΔBIC {_difference(r)})" for r in rivals)
        others_fit = "Another law fits" if len(rivals) == 1 else "Other laws fit"
        lines.append(f"{others_fit} about as well: {listed}.")
    laws = [other for other in others if other["terms"] or findings["terms"]]
    if laws and not equal and not rivals:
        nearest = min(laws, key=lambda other: other["delta_bic"])
        law = alternative_text(nearest) if nearest["terms"] else "that nothing is missing"
        lines.append(f"The next best explanation, {law}, is worse by ΔBIC {_difference(nearest)}.")
    return lines


def location(where: Mapping[str, Any] | None, units: Mapping[str, str]) -> list[str]:
    """Return in which equations, and where and when, the law acts."""
    if where is None:
        return []
    shares = sorted(where["equation"].items(), key=lambda item: -item[1])
    acting = [(field, share) for field, share in shares if share] or shares
    equations = f"the equation of {acting[0][0]}"
    if len(acting) > 1:
        listed = [f"{field} ({percent(share)})" for field, share in acting]
        equations = f"the equations of {joined(listed)}"
    return [f"It acts in {equations}, {extent(where, units)}."]


def extent(where: Mapping[str, Any], units: Mapping[str, str] = NO_UNITS) -> str:
    """Return ``for 10.1 < x < 16.0 (± 0.1)``, ``where u > 1.76 (…)``, or ``everywhere``."""
    if where["region"]:
        [region] = where["region"]
        return f"for {bounds(region, units)}"
    return f"where {where['regime']}" if where["regime"] else "everywhere"


def consequences(findings: Mapping[str, Any]) -> list[str]:
    """Return what the law changes in the system's energy and in its structure."""
    return [*_energy(findings["energy"]), *_structure(findings["structure"])]


def _energy(energy: Mapping[str, Any] | None) -> list[str]:
    """Return how much energy the corrected system loses or gains per cycle."""
    if energy is None:
        return []
    first, last = (_share(energy[name]) for name in ("first", "last"))
    cycles = energy["cycles"]
    return [
        f"The energy of the corrected system {first} in the first cycle and {last} in the last of "
        f"{cycles} cycles."
    ]


def _structure(found: Mapping[str, Any] | None) -> list[str]:
    """Return the parts of a port-Hamiltonian system that change, and whether it remains one."""
    if found is None:
        return []
    kept = found["port_hamiltonian"]
    remains = "remains" if kept else "is not"
    changes = "; ".join(f"{each['term']} changes {_part(each, kept)}" for each in found["changes"])
    return [f"{changes}. The corrected system {remains} port-Hamiltonian."]


def _part(change: Mapping[str, Any], kept: bool) -> str:
    if change["part"] == "R" and not change["passive"]:
        return "R, and reduces the dissipation" if kept else "R, and adds energy"
    return PARTS[change["part"]]


def _share(share: Mapping[str, Any]) -> str:
    size = with_error(100 * abs(share["lost"]), 100 * share["std"])
    return f"{'decreases' if share['lost'] >= 0 else 'increases'} by {size} %"


def limits(findings: Mapping[str, Any]) -> list[str]:
    """Return what an analysis of snapshots cannot determine."""
    if findings["verdict"] not in UNTESTED:
        return []
    return [sentence(text) for text in findings["causes"][0]["cannot_know"]]


def _with_bounds(term: Mapping[str, Any], units: Mapping[str, str]) -> str:
    region = term["region"]
    return in_symbols(term, f"for {bounds(region[0], units)}" if region else None)


def in_symbols(term: Mapping[str, Any], where: str | None) -> str:
    """Return a term in symbols: ``u: −0.0251·u³ for u > 0.4``, ``nu +0.015``.

    Args:
        term: found or tried.
        where: the region in which it acts, as text; None everywhere.
    """
    value = number(float(f"{term['coefficient']:.3g}"))
    if term["equation"] is None:
        sign = "+" if term["coefficient"] > 0 else ""
        return f"{term['term']} {sign}{value}"
    region = f" {where}" if where else ""
    return f"{term['equation']}: {value}·{parenthesize_sum(pretty(term['term']))}{region}"


def _difference(alternative: Mapping[str, Any]) -> str:
    return number(float(f"{alternative['delta_bic']:.2g}"))
