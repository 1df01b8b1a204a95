"""The law that was found, and the other laws that fit, as text."""

from collections.abc import Mapping, Sequence
from typing import Any

from dashred.core.formatting import number, parenthesize_sum, pretty, sentence
from dashred.core.units import NO_UNITS
from dashred.reporting.text.regions import bounds
from dashred.reporting.text.sources import located_source
from dashred.reporting.text.support import is_confirmed, is_unsupported, names_nearest_law

# Of more terms than a few, the smallest law that explains nearly all is reported, too.
FEW, NEARLY = 3, 0.95
SUGGESTED = "Suggested, but not confirmed"


def has_law(findings: Mapping[str, Any]) -> bool:
    """Return whether there are terms that do not express a localised source."""
    found = located_source(findings)
    return bool(findings["terms"]) and not (found and found["as_terms"])


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
    return ["no held-out data support this law: it does not reduce the error on any of them"]


def other_laws(findings: Mapping[str, Any]) -> list[str]:
    """Return the other laws that fit, and the best of those that do not."""
    others = _of_other_terms(findings["alternatives"] or [], findings["terms"] or [])
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


def _of_other_terms(
    others: Sequence[Mapping[str, Any]], terms: Sequence[Mapping[str, Any]]
) -> list[Mapping[str, Any]]:
    """Return the laws without those of the same terms as the best or an earlier one.

    They differ in the errors of sensors alone, which the causes list.
    """
    found: dict[frozenset[tuple[str | None, str, bool]], Mapping[str, Any]] = {}
    own = _terms_of(terms)
    for other in others:
        if (key := _terms_of(other["terms"])) != own:
            found.setdefault(key, other)
    return list(found.values())


def _terms_of(terms: Sequence[Mapping[str, Any]]) -> frozenset[tuple[str | None, str, bool]]:
    """Return the equations and names of terms, and whether each acts in a region."""
    return frozenset((t["equation"], t["term"], bool(t.get("region"))) for t in terms)


def alternative_text(alternative: Mapping[str, Any]) -> str:
    """Return the law of an alternative: ``u: 0.0249·u, u: −0.0251·u³``; ``nothing``."""
    terms = (in_symbols(term, term["region"]) for term in alternative["terms"])
    return ", ".join(terms) or "nothing"


def _difference(alternative: Mapping[str, Any]) -> str:
    return number(float(f"{alternative['delta_bic']:.2g}"))


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
