"""The oracle: the true form, fitted from the true start, in the score by which laws are compared.

Where it does no better than another law, the recording cannot tell them apart: the case is
undecidable, and no analysis is to be blamed. Where it does better than what was returned, the
search has failed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
import xarray as xr
from torch import Tensor

from dashred.config import load_config
from dashred.evaluation.proof.cases.case_record import Oracle
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import Concealed
from dashred.evaluation.twins.kept_findings import read_findings
from dashred.evaluation.twins.recorder import expression_of
from dashred.evaluation.twins.window_kinds import WindowKind, kind_found, kind_of, kind_of_region
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import Fitted, minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.hypotheses.windows.windowed_hypothesis import Guess, Hypothesis
from dashred.inference.initial_state.start_models import StartModel, nearest
from dashred.physics.library import resolve
from dashred.physics.system import Term
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.objectives import build_least_squares, exact_simulator
from dashred.pipeline.problem import Problem, build_problem
from dashred.pipeline.simulation import simulate_nominal

# What a true form has to beat others by for a case to be decidable.
DECIDABLE = 6.0
STEPS, TOLERANCE = 12, 1e-4
WORST = 1e6
# In units of its size, the prior of a true coefficient: hardly any, as of those returned.
FREE = 100.0
KEPT: dict[str, tuple[StartModel, list[Candidate]]] = {}


@torch.no_grad()
def consult(case: Case, concealed: Concealed, folder: Path, *, exact: bool) -> Oracle | None:
    """Return how the true form compares with what was returned; None where no law was hidden.

    The form that was returned keeps its coefficients; start and noise are everybody's own and the
    true form's own. Where none was returned, the simulator as it is stands for it.

    Args:
        case: what was drawn.
        concealed: the truth.
        folder: of the frozen findings.
        exact: whether these have the true form, or one that does the same and says so.
    """
    truth = concealed.truth
    lawful = bool(truth.terms or truth.concealed.parameters)
    if not lawful or truth.concealed.faults:
        return None
    findings = read_findings(folder)
    words = (*case.analysis_words, f"recording.path={folder / 'recording.nc'}")
    simulator = build_problem(load_config([f"conf={case.system}", *words], entry="train"))
    start, library = known(case.system, simulator)
    z, p = nearest(start, truth.states[0]), len(library)

    candidates = _true_candidates(simulator, library, concealed)
    mine = _objective(simulator, start, candidates, None)
    begin = torch.cat([z, torch.tensor(_coefficients(concealed), dtype=torch.float64)])
    fitted = minimise(mine, begin, STEPS, TOLERANCE)
    normal = mine.linearise(fitted.phi, fitted.readings)
    noise = mine.noise_left(fitted.readings, normal.spent(range(len(begin))))
    fitted = minimise(replace(mine, noise=noise), fitted.phi, STEPS, TOLERANCE)
    kinds = [kind_of(term.window) for term in truth.terms]
    kinds += [None] * len(truth.concealed.parameters)
    score = fitted.cost + _penalty(kinds, noise, p, simulator)

    null = _fit_start(simulator, start, z, noise).cost
    returned = null
    if findings["terms"] is not None:
        corrected = build_problem(
            load_config([f"conf={folder / 'corrected.yaml'}", *words], entry="train")
        )
        found = [kind_found(entry["region"]) for entry in findings["terms"]]
        # Under chaos a law that is a little off cannot be brought from the true start to its own.
        begins = (z, nearest(start, _start_found(folder, simulator)))
        cost = min(_fit_start(corrected, start, begin, noise).cost for begin in begins)
        returned = cost + _penalty(found, noise, p, simulator)
    # What blows up from the true start is worse than anything that does not.
    lost, over_null = (min(value - score, WORST) for value in (returned, null))
    rival = _nearest_rival(findings) if exact else 0.0
    over_rival = None if rival is None else lost + rival
    of_library = _nearest_of_library(simulator, findings)
    return {
        "over_null": over_null,
        "over_rival": over_rival,
        "decidable": min(over_null, math.inf if over_rival is None else over_rival) > DECIDABLE,
        "lost": lost,
        "over_library": None if of_library is None else lost + of_library,
    }


def _objective(
    problem: Problem,
    start: StartModel,
    candidates: Sequence[Candidate],
    noise: NoiseModel | None,
) -> LeastSquaresProblem:
    """Return F of a law over the fit window."""
    simulator = exact_simulator(problem, candidates)
    weak = problem.config.discovery.weak
    posed = build_least_squares(problem, simulator, start, candidates, weak)
    return posed if noise is None else replace(posed, noise=noise)


def _fit_start(problem: Problem, start: StartModel, z: Tensor, noise: NoiseModel) -> Fitted:
    """Fit the start alone, of a simulator as it is."""
    return minimise(_objective(problem, start, (), noise), z, STEPS, TOLERANCE)


def _start_found(folder: Path, problem: Problem) -> Tensor:
    """Return the start that the findings say the recording had, ``(field, *grid)``."""
    with xr.open_dataset(folder / "estimates.nc", engine="h5netcdf") as estimates:
        first = estimates.sel({"method": "corrected"}).isel(time=0)
        fields = [torch.from_numpy(first[field].values) for field in problem.system.fields]
    return torch.stack(fields)


def _true_candidates(
    problem: Problem, library: Sequence[Candidate], concealed: Concealed
) -> list[Candidate]:
    """Return what is true as candidates, the terms with their windows as they are."""
    system, truth = problem.system, concealed.truth
    found = []
    for term in truth.terms:
        whole = Term(term.equation, expression_of(system, term))
        [ready] = resolve(system, [whole])
        scale = FREE * abs(term.coefficient)
        found.append(Candidate(str(whole), term.equation, (ready,), scale))
    for name in truth.concealed.parameters:
        found.append(next(c for c in library if name == c.name or name in c.aliases))
    return found


def _coefficients(concealed: Concealed) -> list[float]:
    truth, known = concealed.truth, concealed.system.config.parameters
    changes = [value - known[name] for name, value in truth.concealed.parameters.items()]
    return [*(term.coefficient for term in truth.terms), *changes]


def _penalty(
    kinds: Sequence[WindowKind | None], noise: NoiseModel, p: int, problem: Problem
) -> float:
    """Return what a law's freedom costs, by the windows of its terms."""
    everywhere = tuple(range(kinds.count(None)))
    inside = tuple(range(len(kinds) - len(everywhere)))
    guess = None
    if inside:
        kind = next(kind for kind in kinds if kind is not None)
        shape = next(s for s in window_shapes(problem.system) if kind == (s.of, s.side))
        places = (0.0,) * len(shape.names)
        guess = Guess(shape, places, places)
    hypothesis = Hypothesis(everywhere, inside, guess)
    return hypothesis.penalty(noise.effective_count, p, len(window_shapes(problem.system)))


def _nearest_rival(findings: Mapping[str, Any]) -> float | None:
    """Return by how much the best law of another form is worse than the best.

    A law that holds the best one, and more, is no rival of it; nor is the same in a window.
    """
    mine = {(e["equation"], e["term"]) for e in findings["terms"]}
    window = {kind_found(e["region"]) for e in findings["terms"]} - {None}

    def holds(terms: Sequence[Mapping[str, Any]]) -> bool:
        windows = {kind_of_region(t["window"]) for t in terms} - {None}
        return mine <= {(t["equation"], t["term"]) for t in terms} and window <= windows

    laws = [(a["delta_bic"], a["terms"]) for a in findings["alternatives"]]
    return min((delta for delta, terms in laws if not holds(terms)), default=None)


def _nearest_of_library(problem: Problem, findings: Mapping[str, Any]) -> float | None:
    """Return by how much the best law of the library is worse than the one that was returned."""
    known = {(term.equation, str(term)) for term in problem.library}

    def inside(terms: Sequence[Mapping[str, Any]]) -> bool:
        return all(t["equation"] is None or (t["equation"], t["term"]) in known for t in terms)

    if inside(findings["terms"] or []):
        return 0.0
    others = [a["delta_bic"] for a in findings["alternatives"] if inside(a["terms"])]
    return min(others, default=None)


def known(name: str, problem: Problem) -> tuple[StartModel, list[Candidate]]:
    """Return a system's start prior and its candidates: the same for all of its cases."""
    if name not in KEPT:
        nominal = simulate_nominal(problem, {})
        apart = keep_identifiable_terms(problem, nominal.states, problem.times)
        library = build_candidates(problem.system, apart.library, nominal.states, problem.times)
        KEPT[name] = nominal.start, library
    return KEPT[name]
