"""Discover: fit the start and a sparse law together, through the simulator, to the sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate, build_candidates, indices_by_name
from dashred.discovery.discovered import Discovered
from dashred.discovery.gauss_newton import Normal, Objective
from dashred.discovery.horizon import Walk, first_samples, fit_first_window, walk
from dashred.discovery.law import Law, posterior
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.seeds import NetworkEstimate, Readings, SeedSettings, make_seeds
from dashred.discovery.selection import Selection, Tried, polish, select
from dashred.discovery.shooting import Shooting, Simulator
from dashred.discovery.starts import StartModel
from dashred.discovery.subsets import Eliminated
from dashred.physics.ensemble import Ensemble
from dashred.physics.library import resolve
from dashred.physics.resolution import Resolution
from dashred.progress import Report, stage
from dashred.stages.assimilation import Assimilated
from dashred.stages.learning import Learned
from dashred.stages.problem import Problem
from dashred.stages.simulation import Nominal
from dashred.tracking import Tracker

# σ is taken for at least this share of a trace's std until residuals tell it: a recording may be
# finer than any law that could be found in it, and a search that believes it gets stuck.
FLOOR = 0.01
# How often further candidates join a walk that has got lost.
REINFORCEMENTS = 2
# How many standard errors a seed must validate better than the prior to go before it.
CHANCE = 2.0
# A step that gains a smaller share of F ends a fit: of the law, and of the simulator as it is,
# whose misfit is so large that more would be spent for nothing.
POLISHED, SETTLED = 1e-5, 1e-3
# Rivals that are kept, with their distance from the best.
KEPT = 6
NEAR = 12.0


@dataclass(frozen=True)
class Seed:
    """A seed that was fitted to the first window.

    Attributes:
        name: of the seed.
        start: u₀(z).
        z: its fit, ``(mode,)``.
        error: RMSE on the validation sensors in σ; of the fit sensors, where none validates.
        count: how many values that is over.
    """

    name: str
    start: StartModel
    z: Tensor
    error: float
    count: int


@torch.no_grad()
def discover(
    problem: Problem,
    nominal: Nominal,
    resolution: Resolution,
    ensemble: Ensemble,
    learned: Learned,
    found: Assimilated,
    run: Tracker,
    seconds: dict[str, float],
) -> Discovered:
    """Seed, walk the horizon, select, and fit to the end (design §4.2)."""
    begin = float(problem.times[0])
    candidates = build_candidates(problem.system, problem.library, nominal.states, begin)
    proposals = _proposals(problem, candidates, found)
    with run.child("discover") as child:
        with stage("seed the start", seconds) as report:
            simulator = _simulator(problem, candidates)
            rough = _rough(problem, simulator, resolution)
            seeds = _fit_seeds(problem, rough, nominal, ensemble, learned, found, report)
            report(1.0, ", ".join(f"{s.name} {s.error:.2f}" for s in seeds) + " σ on validation")
        child.log_metrics({f"seed/{s.name}": s.error for s in seeds if math.isfinite(s.error)}, 0)
        with stage("grow the horizon", seconds) as report:
            seed, walked, phi = _walk(problem, rough, candidates, seeds, report)
            child.set_tags({"seed of the start": seed.name})
        for samples, level in walked.levels:
            child.log_metrics({"horizon/chi2": level}, samples)
        weak = problem.config.discovery.weak
        objective = _objective(problem, simulator, seed.start, candidates, weak)
        objective = replace(objective, noise=_noise_after(objective, walked))
        with stage("select the law", seconds) as report:
            selection = select(objective.until(walked.samples), phi, proposals, report)
            if not walked.reached:
                walked, selection = _walk_on(objective, walked, selection, proposals, report)
            report(1.0, f"{len(selection.tried)} sets refitted")
        with stage("fit the law to the end", seconds) as report:
            laws, nothing = _finish(selection)
            report(1.0, str(laws[0]))
        for size, score in _path(selection):
            child.log_metrics({"evidence/score": score}, size)
    noise = selection.objective.noise
    recorded = selection.objective.recorded
    free = noise.whiten(walked.fitted.readings - recorded).square().sum()
    return Discovered(
        laws=laws,
        nothing=nothing,
        noise=noise,
        seeds={s.name: s.error for s in seeds},
        seed=seed.name,
        levels=walked.levels,
        reached=walked.reached,
        free_chi2=float(free) / noise.count,
        exhausted=selection.exhausted,
        path=_path(selection),
        tried=len(selection.tried),
    )


def _simulator(problem: Problem, candidates: Sequence[Candidate]) -> Simulator:
    dt = problem.config.simulation.dt or problem.system.dt
    return Simulator(problem.system, dt, candidates)


def _rough(problem: Problem, simulator: Simulator, resolution: Resolution) -> Simulator:
    """Return the simulator that is good enough while the horizon grows.

    With the derivative's longer steps, if their error, of fourth order, stays far below the noise.
    """
    names = problem.split.fit.names
    noise = float((problem.noise_of(names) / _spread(problem).clamp(min=1e-300)).median())
    longer = simulator.tangent.dt / simulator.system.dt
    return simulator.coarse() if resolution.error * longer**4 < noise / 3 else simulator


def _spread(problem: Problem) -> Tensor:
    """Return the std of each fit sensor's trace, ``(sensor,)``."""
    values = torch.from_numpy(problem.split.fit.values)
    return (values - values.nanmean(dim=0)).square().nanmean(dim=0).sqrt()


def _objective(
    problem: Problem,
    simulator: Simulator,
    start: StartModel,
    candidates: Sequence[Candidate],
    prior: float,
) -> Objective:
    fit = problem.split.fit
    operator = problem.operator(fit)
    times = problem.times[: len(fit.times)]
    recorded = torch.from_numpy(fit.values)
    std = torch.maximum(problem.noise_of(fit.names), FLOOR * _spread(problem))
    noise = NoiseModel(std, 0.0, ~torch.isnan(recorded))
    scales = torch.tensor([c.scale for c in candidates], dtype=torch.float64)
    shooting = Shooting(simulator, start, candidates, operator, times)
    return Objective(shooting, recorded, noise, prior * scales)


def _proposals(
    problem: Problem, candidates: Sequence[Candidate], found: Assimilated
) -> list[tuple[int, ...]]:
    """Return the sets that Algorithms 1 and 2 propose, as candidates."""
    index = indices_by_name(candidates)
    names = [f"{term.equation}: {term}" for term in problem.library]
    sets = []
    for fit in found.proposals.values():
        chosen = {index[name] for name, value in zip(names, fit.coefficients, strict=True) if value}
        sets.append(tuple(sorted(chosen)))
    return [members for members in sets if members]


def _fit_seeds(
    problem: Problem,
    simulator: Simulator,
    nominal: Nominal,
    ensemble: Ensemble,
    learned: Learned,
    found: Assimilated,
    report: Report,
) -> list[Seed]:
    """Fit every seed to the first window and return them, the best on validation first."""
    fit = problem.split.fit
    readings = Readings(
        problem.times[: len(fit.times)],
        torch.from_numpy(fit.values),
        problem.operator(fit),
        problem.noise_of(fit.names),
    )
    error = torch.tensor([learned.test_rmse[f] for f in problem.system.fields]) * learned.scale
    settings = problem.config.simulation
    system = problem.system if settings.dt is None else problem.system.with_step(settings.dt)
    models = make_seeds(
        system,
        nominal.prior,
        ensemble,
        resolve(problem.system, problem.library),
        readings,
        NetworkEstimate(found.dashred[0], error),
        SeedSettings(),
    )
    fitted = []
    for i, (name, model) in enumerate(models.items(), start=1):
        fitted.append(_fit_seed(problem, simulator, name, model))
        report(i / len(models), f"{name} {fitted[-1].error:.2f} σ")
    return _ranked(fitted)


def _ranked(seeds: Sequence[Seed]) -> list[Seed]:
    """Return the best on validation first; the prior, where chance may have put others before it.

    The rms of n values is uncertain by ``1/√(2n)``, and of all seeds the prior alone uses no data
    twice.
    """
    ranked = sorted(seeds, key=lambda seed: seed.error)
    best = ranked[0].error * (1 + CHANCE / math.sqrt(2 * ranked[0].count))
    return sorted(ranked, key=lambda seed: not (seed.name == "prior" and seed.error <= best))


def _fit_seed(problem: Problem, simulator: Simulator, name: str, model: StartModel) -> Seed:
    objective = _objective(problem, simulator, model, [], 1.0)
    fitted = fit_first_window(objective, _spread(problem))
    samples = first_samples(objective)
    nothing = torch.zeros((1, 0), dtype=torch.float64)
    validation = problem.split.validation
    sensors = validation if problem.split.validate else problem.split.fit
    shooting = replace(objective.shooting.until(samples), operator=problem.operator(sensors))
    error = shooting.readings(fitted.phi[None], nothing)[0] - torch.from_numpy(
        sensors.values[:samples]
    )
    scaled = error / problem.noise_of(sensors.names)
    rmse = float(scaled.square().nanmean().sqrt())
    count = int(torch.isfinite(scaled).sum())
    return Seed(name, model, fitted.phi, rmse if math.isfinite(rmse) else math.inf, max(count, 1))


def _walk(
    problem: Problem,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    seeds: Sequence[Seed],
    report: Report,
) -> tuple[Seed, Walk, Tensor]:
    """Walk from the best seed; where it gets lost, from the next; keep who came farthest."""
    best: tuple[Seed, Walk, Tensor] | None = None
    for seed in seeds:
        walked, phi = _walk_from(problem, simulator, candidates, seed, report)
        if best is None or walked.samples > best[1].samples:
            best = seed, walked, phi
        if walked.reached:
            break
    assert best is not None
    return best


def _walk_from(
    problem: Problem,
    simulator: Simulator,
    candidates: Sequence[Candidate],
    seed: Seed,
    report: Report,
) -> tuple[Walk, Tensor]:
    """Walk with the candidates whose effects differ most; the others' place they can take.

    Where the walk gets lost, those that differ most there join in.
    """
    settings = problem.config.discovery
    whole = _objective(problem, simulator, seed.start, candidates, settings.tight)
    limits = torch.tensor([c.limit for c in candidates], dtype=torch.float64)
    whole = replace(whole, prior_std=torch.minimum(whole.prior_std, limits))
    phi, samples = whole.embed(seed.z, []), first_samples(whole)
    members: tuple[int, ...] = ()
    for _ in range(REINFORCEMENTS + 1):
        members = tuple(sorted({*members, *_most_telling(whole, phi, samples, settings.walking)}))
        walked = walk(whole.only(members), phi[whole.places(members)], samples, report)
        phi, samples = whole.embed(walked.fitted.phi, members), walked.samples
        if walked.reached:
            break
    return walked, phi


def _most_telling(whole: Objective, phi: Tensor, samples: int, count: int) -> tuple[int, ...]:
    """Return the candidates whose effects differ most, a while beyond the samples fitted so far.

    None at all, where the fit blows up even within them.
    """
    for reach in (3 * samples, samples):
        window = whole.until(min(len(whole.recorded), reach))
        point = window.shooting.linearise(*window.split(phi))
        residuals = window.residuals(point.readings)
        normal = Normal.of(window, point)
        if torch.isfinite(residuals).all() and torch.isfinite(normal.jacobian).all():
            return Eliminated.of(normal, whole.modes, residuals, phi).most_telling(count)
    return ()


def _noise_after(objective: Objective, walked: Walk) -> NoiseModel:
    """Return the noise that the residuals of the walk speak for: its size and its correlation."""
    part = objective.until(walked.samples)
    groups = [sensor.reads for sensor in objective.shooting.operator.sensors]
    left = walked.fitted.readings - part.recorded
    found = part.noise.estimated(left, groups, len(walked.fitted.phi))
    return replace(found, seen=objective.noise.seen)


def _walk_on(
    objective: Objective,
    walked: Walk,
    selection: Selection,
    proposals: list[tuple[int, ...]],
    report: Report,
) -> tuple[Walk, Selection]:
    """Walk on with the law that was found so far, and select once more where that leads.

    All candidates together may have lost a trajectory that the right few can follow.
    """
    best = selection.tried[0]
    mine = objective.only(best.members)
    begin = best.phi[objective.places(best.members)]
    further = walk(mine, begin, walked.samples, report)
    if further.samples == walked.samples:
        return walked, selection
    phi = objective.embed(further.fitted.phi, best.members)
    sets = [*proposals, *(tried.members for tried in selection.tried[:KEPT])]
    levels = [*walked.levels, *further.levels[1:]]
    found = select(objective.until(further.samples), phi, sets, report)
    return replace(further, levels=levels), found


def _finish(selection: Selection) -> tuple[list[Law], Law]:
    """Fit the best law and the empty one to the end; rivals stay as the search left them."""
    objective = selection.objective
    best = polish(objective, selection.tried[0], POLISHED)
    point = objective.shooting.linearise(*objective.split(best.phi))
    normal = Normal.of(objective, point)
    near = [t for t in selection.tried[1:] if t.score < best.score + NEAR][:KEPT]
    single = next((t for t in selection.tried if len(t.members) == 1), None)
    if single is not None and len(best.members) > 1 and all(t is not single for t in near):
        near.append(single)
    empty = next(t for t in selection.tried if not t.members)
    nothing = best if not best.members else polish(objective, empty, SETTLED)

    def law(tried: Tried) -> Law:
        [readings] = objective.shooting.readings(*objective.split(tried.phi[None]))
        return posterior(objective, normal, tried.phi, tried.members, readings, tried.score)

    ranked = sorted([best, *near], key=lambda tried: tried.score)
    return [law(tried) for tried in ranked], law(nothing)


def _path(selection: Selection) -> list[tuple[int, float]]:
    """Return the best score by the number of candidates."""
    best: dict[int, float] = {}
    for tried in selection.tried:
        size = len(tried.members)
        best[size] = min(best.get(size, math.inf), tried.score)
    return sorted((size, score) for size, score in best.items() if math.isfinite(score))
