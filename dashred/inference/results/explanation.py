"""The law that was found, in plain words, with error bars and probabilities."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from dashred.core.findings.law_schema import (
    Alternative,
    ParameterChange,
    SmallerLaw,
    TermFound,
    TermTried,
)
from dashred.core.formatting import number, rounded
from dashred.core.units import with_unit
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.result import AMBIGUOUS, Discovery
from dashred.inference.results.parameter_change import exact_change, is_exact, parameter_change
from dashred.inference.results.posterior_probabilities import inclusion
from dashred.inference.wording.wording import words
from dashred.physics.expressions.algebra import Expr
from dashred.physics.system import System
from dashred.physics.term_units import coefficient_unit

MOST_ALTERNATIVES = 3
# Of a law that is worse by less there is something to say.
NEAR = 12.0


def explain(system: System, discovered: Discovery) -> list[TermFound | ParameterChange]:
    """Return ``findings["terms"]``: one entry for each candidate of the best law."""
    law = discovered.best
    found: list[TermFound | ParameterChange] = []
    for index, candidate in enumerate(law.candidates):
        included = inclusion(discovered, candidate)
        if candidate.equation is None:
            found.append(_parameter(system, law, index, included))
        else:
            found.append(_term(system, law, index, included))
    return found


def alternatives(discovered: Discovery, system: System) -> list[Alternative]:
    """Return at most three other laws: rivals first, then by score.

    Of a law of several terms the best one-term law is among them, for comparison.
    """
    best, rivals = discovered.best, discovered.rivals
    # Laws hold tensors, which do not compare to one truth: identity decides.
    decided = {id(law) for law in rivals}
    others = [law for law in discovered.laws[1:] if id(law) not in decided]
    chosen = [*rivals, *others][:MOST_ALTERNATIVES]
    single = [law for law in discovered.laws[1:] if len(law.candidates) == 1]
    listed = {id(law) for law in chosen}
    if single and len(best.candidates) > 1 and id(single[0]) not in listed:
        # One that is nearly as good says more.
        near = [law for law in chosen if law.score < best.score + NEAR]
        chosen = [*near, single[0]] if len(near) < MOST_ALTERNATIVES else chosen
    return [
        Alternative(
            terms=_tried(system, law.candidates, law.coefficients.tolist()),
            delta_bic=law.score - best.score,
            rival=id(law) in decided,
            same_as_best=_reads_the_same(discovered, law),
        )
        for law in chosen
    ]


def smaller(discovered: Discovery, system: System) -> list[SmallerLaw]:
    """Return the best laws of fewer terms than the best law has, where that acts everywhere.

    What one explains is ``(F₀ - F_k) / (F₀ - F)``: F of no law, of k terms, and of all.
    """
    count = len(discovered.best.candidates)
    misfits = {len(law.candidates): law.rmse**2 for law in discovered.path}
    if discovered.best.window is not None or not {0, count} <= misfits.keys() or not count:
        return []
    explained = misfits[0] - misfits[count]
    return [
        SmallerLaw(
            terms=_tried(system, law.candidates, law.coefficients),
            explained=(misfits[0] - law.rmse**2) / explained,
        )
        for law in discovered.path
        if 0 < len(law.candidates) < count
    ]


def law_in_words(law: Law, system: System) -> str:
    """Return the law in one sentence for what is missing and one for what is mis-stated."""
    every = range(len(law.candidates))
    missing = [_says(system, law, i) for i in every if law.candidates[i].equation is not None]
    changed = [_says(system, law, i) for i in every if law.candidates[i].equation is None]
    sentences = []
    if missing:
        sentences.append(f"The simulation leaves out {'; and '.join(missing)}.")
    if changed:
        sentences.append(f"A parameter is mis-stated: {'; and '.join(changed)}.")
    return " ".join(sentences) or "The simulation leaves out nothing that the recording shows."


def _term(system: System, law: Law, index: int, included: float) -> TermFound:
    candidate = law.candidates[index]
    assert candidate.equation is not None
    found = TermFound(
        equation=candidate.equation,
        term=candidate.name,
        coefficient=float(law.coefficients[index]),
        std=float(law.std[index]),
        ci95=list(law.interval(index)),
        inclusion=included,
        region=region_of(law) if candidate.window is not None else None,
        says=_says(system, law, index),
    )
    unit = coefficient_unit(system, candidate.equation, _expression(system, candidate))
    if unit is not None:
        found["unit"] = unit
    return found


def region_of(law: Law) -> list[dict[str, Any]] | None:
    """Return where the law acts, if not everywhere, with the edges' standard deviations.

    ``{axis, from, to}`` of a box, ``{axis: t, from}`` of an onset, ``{field, above | below}`` of
    a gate, with its threshold's ``ci95``; ``std`` of a box's edges is that of its centre and its
    half width together.
    """
    window = law.window
    if window is None:
        return None
    of, kind, values, stds = window.shape.of, window.shape.kind, window.values, law.edges
    if kind == "box":
        std = math.hypot(stds[0], stds[1])
        begin, end = values[0] - values[1], values[0] + values[1]
        return [{"axis": of, "from": begin, "to": end, "std": std}]
    if kind == "onset":
        return [{"axis": "t", "from": values[0], "std": stds[0]}]
    gate = {"field": of, kind.removeprefix("gate "): values[0], "std": stds[0]}
    return [gate | ({"ci95": list(law.threshold)} if law.threshold else {})]


def _parameter(system: System, law: Law, index: int, included: float) -> ParameterChange:
    candidate = law.candidates[index]
    old = system.config.parameters[candidate.name]
    change, std = _change(system, law, index)
    found: ParameterChange = {
        "equation": None,
        "parameter": candidate.name,
        "term": candidate.name,
        "from": old,
        "to": old + change,
        "coefficient": change,
        "std": std,
        "ci95": [old + change + end for end in _ends(system, law, index)],
        "aliases": list(candidate.aliases),
        "inclusion": included,
        "region": None,
        "says": _says(system, law, index),
    }
    if candidate.name in system.units:
        found["unit"] = system.units[candidate.name]
    return found


def _change(system: System, law: Law, index: int) -> tuple[float, float]:
    """Return by how much a parameter is other than believed, and the standard deviation of that."""
    name, xi = law.candidates[index].name, float(law.coefficients[index])
    std = float(law.std[index])
    ahead, behind = (parameter_change(system, name, xi + step) for step in (std / 2, -std / 2))
    return parameter_change(system, name, xi), abs(ahead - behind)


def _ends(system: System, law: Law, index: int) -> list[float]:
    """Return the ends of a parameter's 95 % interval, relative to the change that was found."""
    name, xi = law.candidates[index].name, float(law.coefficients[index])
    change = exact_change(system, name, xi)
    found = []
    for end in law.interval(index):
        there = exact_change(system, name, end)
        found.append(end - xi if change is None or there is None else there - change)
    return sorted(found)


def _says(system: System, law: Law, index: int) -> str:
    candidate = law.candidates[index]
    value, std = float(law.coefficients[index]), float(law.std[index])
    if candidate.equation is not None:
        says = words(system, candidate.equation, _expression(system, candidate), value, std)
        window = candidate.window
        return says if window is None else f"{says}, {window.describe(system.units)}"
    old = system.config.parameters[candidate.name]
    change, std = _change(system, law, index)
    new, error = rounded(old + change, std)
    about = (
        ""
        if is_exact(system, candidate.name, value)
        else ", to first order in the change, whose tangent stands in the corrected equations"
    )
    told = with_unit(new, system.units.get(candidate.name))
    says = f"{candidate.name} is {told}, not {number(old)} (± {error}{about})"
    if candidate.aliases:
        says += f"; a change of {' or '.join(candidate.aliases)} would do the same"
    return says


def _expression(system: System, candidate: Candidate) -> Expr:
    """Return a library term as it was written, without its window."""
    assert candidate.equation is not None
    key = f"library.{candidate.equation}"
    return system.parse(candidate.name, key, equation=candidate.equation)


def _tried(
    system: System, candidates: Sequence[Candidate], coefficients: Sequence[float]
) -> list[TermTried]:
    return [
        TermTried(
            equation=candidate.equation,
            term=candidate.name,
            coefficient=value
            if candidate.equation
            else parameter_change(system, candidate.name, value),
            region=candidate.window.describe(system.units) if candidate.window else None,
        )
        for candidate, value in zip(candidates, coefficients, strict=True)
    ]


def _reads_the_same(discovered: Discovery, law: Law) -> bool:
    """Whether the two laws' readings differ by less, in χ², than what tells rivals apart."""
    difference = discovered.noise.whiten(law.residuals - discovered.best.residuals)
    return float(difference.square().sum()) < AMBIGUOUS
