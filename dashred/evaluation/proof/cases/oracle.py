"""The oracle: the true form fitted from the true start, in the score that compares laws.

If another law scores as well, the recording cannot separate them, and the case is undecidable. If
the true form scores better than the law that was returned, the search has failed.
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
from dashred.evaluation.proof.cases.effect_size import CaseTruth
from dashred.evaluation.twins.findings_reader import read_findings
from dashred.evaluation.twins.recorder import true_expression
from dashred.evaluation.twins.window_kinds import WindowKind, bounds_kind, region_kind, window_kind
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.hypotheses.windows.windowed_hypothesis import Hypothesis, WindowGuess
from dashred.inference.initial_state.start_models import StartModel, project_state
from dashred.physics.system import Term
from dashred.physics.terms.library import resolve
from dashred.physics.window import window_shapes
from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
from dashred.pipeline.discovery.least_squares import build_least_squares, exact_simulator
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from dashred.pipeline.simulation.state_samples import StateSamples

# Difference in score by which the true form must be better than others in a decidable case.
DECIDABLE = 6.0
STEPS, TOLERANCE = 12, 1e-4
MAX_LOSS = 1e6
# Prior std of a true coefficient over its value: a weak prior, as for the returned coefficients.
PRIOR_FACTOR = 100.0
CACHE: dict[str, tuple[StartModel, list[Candidate]]] = {}


@torch.no_grad()
def compute_oracle(
    case: Case, case_truth: CaseTruth, folder: Path, *, exact: bool
) -> Oracle | None:
    """Return the score of the true form against the returned law; None if no law was hidden.

    The returned law keeps its coefficients, its start is fitted, and the noise is that of the true
    form. If no law was returned, the unchanged simulator takes its place.

    Args:
        case: the case.
        case_truth: its truth.
        folder: folder of the frozen findings.
        exact: whether the findings have the true form or a declared equivalent.
    """
    truth = case_truth.truth
    has_law = bool(truth.terms or truth.concealed.parameters)
    if not has_law or truth.concealed.faults:
        return None
    findings = read_findings(folder)
    words = (*case.analysis_words, f"recording.path={folder / 'recording.nc'}")
    simulator = build_problem(load_config([f"conf={case.system}", *words], entry="train"))
    start, library = prior_and_library(case.system, simulator)
    z, p = project_state(start, truth.states[0]), len(library)

    candidates = _true_candidates(simulator, library, case_truth)
    objective = _objective(simulator, start, candidates, None)
    begin = torch.cat([z, torch.tensor(_coefficients(case_truth), dtype=torch.float64)])
    fitted = minimise(objective, begin, STEPS, TOLERANCE)
    normal = objective.linearise(fitted.phi, fitted.readings)
    noise = objective.estimate_noise(
        fitted.readings, normal.effective_parameters(range(len(begin)))
    )
    fitted = minimise(replace(objective, noise=noise), fitted.phi, STEPS, TOLERANCE)
    kinds = [window_kind(term.window) for term in truth.terms]
    kinds += [None] * len(truth.concealed.parameters)
    score = fitted.cost + _penalty(kinds, noise, p, simulator)

    null = _fit_start(simulator, start, z, noise).cost
    returned = null
    if findings["terms"] is not None:
        corrected = build_problem(
            load_config([f"conf={folder / 'corrected.yaml'}", *words], entry="train")
        )
        found = [region_kind(entry["region"]) for entry in findings["terms"]]
        # In a chaotic system a slightly wrong law cannot be fitted from the true start to its own.
        begins = (z, project_state(start, _estimated_start(folder, simulator)))
        cost = min(_fit_start(corrected, start, begin, noise).cost for begin in begins)
        returned = cost + _penalty(found, noise, p, simulator)
    # A simulation that blows up from the true start gets the largest loss.
    lost, over_null = (min(value - score, MAX_LOSS) for value in (returned, null))
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
    """Return the least-squares problem of a law over the fit window."""
    simulator = exact_simulator(problem, candidates)
    weak = problem.config.discovery.weak
    objective = build_least_squares(problem, simulator, start, candidates, weak)
    return objective if noise is None else replace(objective, noise=noise)


def _fit_start(problem: Problem, start: StartModel, z: Tensor, noise: NoiseModel) -> FitResult:
    """Fit only the start of an unchanged simulator."""
    return minimise(_objective(problem, start, (), noise), z, STEPS, TOLERANCE)


def _estimated_start(folder: Path, problem: Problem) -> Tensor:
    """Return the estimated initial state of the recording, ``(field, *grid)``."""
    with xr.open_dataset(folder / "estimates.nc", engine="h5netcdf") as estimates:
        first = estimates.sel({"method": "corrected"}).isel(time=0)
        fields = [torch.from_numpy(first[field].values) for field in problem.system.fields]
    return torch.stack(fields)


def _true_candidates(
    problem: Problem, library: Sequence[Candidate], case_truth: CaseTruth
) -> list[Candidate]:
    """Return the true terms, with their windows, and parameters as candidates."""
    system, truth = problem.system, case_truth.truth
    found = []
    for term in truth.terms:
        windowed = Term(term.equation, true_expression(system, term))
        [resolved] = resolve(system, [windowed])
        scale = PRIOR_FACTOR * abs(term.coefficient)
        found.append(Candidate(str(windowed), term.equation, (resolved,), scale))
    for name in truth.concealed.parameters:
        found.append(next(c for c in library if name == c.name or name in c.aliases))
    return found


def _coefficients(case_truth: CaseTruth) -> list[float]:
    truth, stated = case_truth.truth, case_truth.system.config.parameters
    changes = [value - stated[name] for name, value in truth.concealed.parameters.items()]
    return [*(term.coefficient for term in truth.terms), *changes]


def _penalty(
    kinds: Sequence[WindowKind | None], noise: NoiseModel, p: int, problem: Problem
) -> float:
    """Return the penalty for the degrees of freedom of a law with these kinds of windows."""
    everywhere = tuple(range(kinds.count(None)))
    inside = tuple(range(len(kinds) - len(everywhere)))
    guess = None
    if inside:
        kind = next(kind for kind in kinds if kind is not None)
        shape = next(s for s in window_shapes(problem.system) if kind == (s.of, s.side))
        places = (0.0,) * len(shape.names)
        guess = WindowGuess(shape, places, places)
    hypothesis = Hypothesis(everywhere, inside, guess)
    return hypothesis.penalty(noise.effective_count, p, len(window_shapes(problem.system)))


def _nearest_rival(findings: Mapping[str, Any]) -> float | None:
    """Return the score difference of the best law of another form to the best law.

    A law that contains the best one is not a rival, and neither is the same law in a window.
    """
    best = {(e["equation"], e["term"]) for e in findings["terms"]}
    window = {region_kind(e["region"]) for e in findings["terms"]} - {None}

    def holds(terms: Sequence[Mapping[str, Any]]) -> bool:
        windows = {bounds_kind(t["window"]) for t in terms} - {None}
        return best <= {(t["equation"], t["term"]) for t in terms} and window <= windows

    laws = [(a["delta_bic"], a["terms"]) for a in findings["alternatives"]]
    return min((delta for delta, terms in laws if not holds(terms)), default=None)


def _nearest_of_library(problem: Problem, findings: Mapping[str, Any]) -> float | None:
    """Return the score difference of the best law of the library to the returned law."""
    known = {(term.equation, str(term)) for term in problem.library}

    def inside(terms: Sequence[Mapping[str, Any]]) -> bool:
        return all(t["equation"] is None or (t["equation"], t["term"]) in known for t in terms)

    if inside(findings["terms"] or []):
        return 0.0
    others = [a["delta_bic"] for a in findings["alternatives"] if inside(a["terms"])]
    return min(others, default=None)


def prior_and_library(name: str, problem: Problem) -> tuple[StartModel, list[Candidate]]:
    """Return the start prior and the candidates of a system, cached for all its cases."""
    if name not in CACHE:
        nominal = simulate_nominal(problem, {})
        apart = keep_identifiable_terms(
            problem, StateSamples(problem.system, nominal.states, problem.times)
        )
        library = build_candidates(problem.system, apart.library, nominal.states, problem.times)
        CACHE[name] = nominal.start, library
    return CACHE[name]
