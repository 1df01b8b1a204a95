"""The search finds the true law or the empty law, and corrects a wrong first set."""

from __future__ import annotations

import math
from collections.abc import Sequence

import pytest
import torch

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.stepwise_moves import Set
from dashred.inference.fit.selection.stepwise_selection import (
    RefittedSet,
    Selection,
    polish,
    select,
    term_penalty,
)
from tests.swing import FORCES, Swing, noisy
from tests.waves import Waves, fitted

SIGMA, WEAK = 0.05, 1.0
NAMES = ("k", "c", *FORCES)
Z = (0.8, -0.6)
LAWS: dict[str, tuple[tuple[str, ...], tuple[float, ...]]] = {
    "one term": (("x**3",), (-0.3,)),
    "a parameter": (("k",), (0.2,)),
    "friction and a tilted spring": (("x**2", "sign(p)"), (0.2, -0.1)),
    "drag and a hardening spring": (("x**3", "abs(p)*p"), (-0.3, -0.15)),
}


def silent(_: float, __: str) -> None:
    """Report nothing."""


def problem(swing: Swing, law: str, seed: int, believed: float = SIGMA) -> LeastSquaresProblem:
    names, values = LAWS.get(law, ((), ()))
    recorded = noisy(swing.clean(Z, names, values), SIGMA, seed)
    return swing.objective(NAMES, recorded, believed, WEAK)


def searched(objective: LeastSquaresProblem, proposals: Sequence[Set] = ()) -> Selection:
    """Select from the fit of all candidates at once under a tight prior."""
    tight = LeastSquaresProblem(
        objective.forward_model, objective.recorded, objective.noise, 0.05 * objective.prior_std
    )
    zero = torch.zeros(objective.modes + len(NAMES), dtype=torch.float64)
    return select(objective, minimise(tight, zero, 6, 1e-3).phi, proposals, silent)


def members(*names: str) -> Set:
    return tuple(sorted(NAMES.index(name) for name in names))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("seed", [0, 1])
def test_the_true_set_is_found(swing: Swing, law: str, seed: int) -> None:
    names, values = LAWS[law]
    found = searched(problem(swing, law, seed))
    best = found.tried[0]
    assert best.members == members(*names) and found.exhausted
    index = found.objective.indices(best.members)
    hessian = found.objective.linearise(best.phi).hessian[index][:, index]
    std = torch.linalg.inv(hessian).diagonal().sqrt()
    truth = torch.zeros(2 + len(NAMES), dtype=torch.float64)
    truth[[2 + NAMES.index(name) for name in names]] = torch.tensor(values, dtype=torch.float64)
    assert (((best.phi - truth)[index] / std)[2:].abs() < 3).all()
    assert (std[2:] < truth[index][2:].abs() / 4).all()
    others = [2 + j for j in range(len(NAMES)) if j not in best.members]
    assert not best.phi[others].any()


def test_the_empty_set_is_selected_if_nothing_is_missing(swing: Swing) -> None:
    found = [searched(problem(swing, "null", seed)).tried[0].members for seed in range(5)]
    assert found.count(()) >= 4


def test_scores_follow_their_definition_and_are_sorted(swing: Swing) -> None:
    found = searched(problem(swing, "one term", 0))
    objective = found.objective
    per_term = math.log(162) + 2 * math.log(len(NAMES))
    assert term_penalty(objective) == pytest.approx(per_term)
    scores = [tried.score for tried in found.tried]
    assert scores == sorted(scores) and len({t.members for t in found.tried}) == len(scores)
    assert () in {tried.members for tried in found.tried}
    for tried in found.tried[:5]:
        [cost] = objective.values(tried.phi[None])[0].tolist()
        assert tried.cost == pytest.approx(cost, rel=1e-9)
        assert tried.score == pytest.approx(cost + per_term * len(tried.members), rel=1e-9)
        # Near its minimum, as found by a separate fit of this set.
        fresh = polish(objective, tried, 1e-8)
        assert fresh.members == tried.members
        assert 0 <= tried.cost - fresh.cost < 1.5
        assert fresh.score == pytest.approx(fresh.cost + per_term * len(fresh.members), rel=1e-9)


def test_rivals_with_stuck_refits_are_refitted(
    swing: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without their own steps, sets remain at the prediction of another linearisation."""
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_selection.CHORD_STEPS", 1)
    found = searched(problem(swing, "one term", 0))
    best, *others = found.tried
    [rival] = [t for t in others if len(t.members) == 1][:1]
    assert rival.cost - polish(found.objective, rival, 1e-8).cost < 0.01
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_selection.RIVALS", 0)
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_moves.ALIKE", 2.0)
    stuck = searched(problem(swing, "one term", 0))
    left = next(t for t in stuck.tried if t.members == rival.members)
    assert left.cost > rival.cost + 0.01
    assert best.members == members("x**3") == stuck.tried[0].members


def test_the_best_set_of_each_smaller_size_is_refitted(
    swing: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    refitted = []

    def recorded(objective: LeastSquaresProblem, tried: RefittedSet, *limits: float) -> RefittedSet:
        refitted.append(tried.members)
        return polish(objective, tried, limits[0])

    module = "dashred.inference.fit.selection.stepwise_selection"
    monkeypatch.setattr(f"{module}.RIVALS", 0)
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_moves.ALIKE", 2.0)
    monkeypatch.setattr(f"{module}.LARGEST_COST_RATIO", math.inf)
    monkeypatch.setattr(f"{module}.SCORE_MARGIN", math.inf)
    monkeypatch.setattr(f"{module}.polish", recorded)
    found = searched(problem(swing, "drag and a hardening spring", 0))
    assert found.tried[0].members == members("x**3", "abs(p)*p")
    [single] = refitted
    assert single == next(t.members for t in found.tried if len(t.members) == 1)


@pytest.mark.parametrize("believed", [0.3, 3.0])
def test_a_wrong_noise_level_is_corrected(swing: Swing, believed: float) -> None:
    objective = problem(swing, "drag and a hardening spring", 0, believed * SIGMA)
    found = searched(objective)
    assert found.tried[0].members == members("x**3", "abs(p)*p")
    std = found.objective.noise.std
    torch.testing.assert_close(std, torch.full((2,), SIGMA).double(), rtol=0.2, atol=0)


@pytest.mark.parametrize("start", [1e3, 1e60, 1e200])
def test_a_search_where_all_sets_blow_up_ends(swing: Swing, start: float) -> None:
    objective = problem(swing, "one term", 0)
    phi = torch.zeros(objective.modes + len(NAMES), dtype=torch.float64)
    phi[: objective.modes] = start
    found = select(objective, phi, [members("x**3")], silent)
    assert found.objective.noise.std.isfinite().all()
    assert float(found.objective.noise.std.max()) < 1e12 * SIGMA


def test_a_proposal_is_always_refitted(swing: Swing) -> None:
    far: list[Set] = [members("1", "sin(3*x)", "x*p", "p**3"), members("x*p", "1", "c")]
    found = searched(problem(swing, "one term", 0), far)
    tried = {found.members for found in found.tried}
    assert set(far) <= tried
    plain = {found.members for found in searched(problem(swing, "one term", 0)).tried}
    assert not set(far) <= plain


@pytest.fixture
def _narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refit only the empty set and the proposals at first."""
    moves = "dashred.inference.fit.selection.stepwise_moves"
    monkeypatch.setattr(f"{moves}.REFITTED", {})
    monkeypatch.setattr(f"{moves}.LARGEST_ON_PATH", 0)


@pytest.mark.usefixtures("_narrow")
@pytest.mark.parametrize(
    "wrong", [(), ("sin(3*x)", "p**3"), ("k", "c"), ("1",), ("k", "abs(p)*p", "x**2")]
)
def test_moves_correct_a_wrong_first_set(swing: Swing, wrong: tuple[str, ...]) -> None:
    found = searched(problem(swing, "drag and a hardening spring", 0), [members(*wrong)])
    assert members(*wrong) in {tried.members for tried in found.tried}
    assert found.tried[0].members == members("x**3", "abs(p)*p") and found.exhausted


@pytest.mark.usefixtures("_narrow")
def test_a_search_cut_short_is_not_exhausted(swing: Swing, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_selection.ROUNDS", 1)
    found = searched(problem(swing, "drag and a hardening spring", 0))
    assert found.tried[0].members != () and not found.exhausted


def test_undetermined_modes_do_not_inflate_the_noise(
    waves: Waves,
) -> None:
    """With 21 readings, a fit of 14 modes has four or five effective parameters."""
    squares = []
    for seed in range(10):
        recorded = waves.recorded(SIGMA, seed)
        recorded[:, 1:] = recorded[1::2] = torch.nan
        z = fitted(waves.objective(recorded, SIGMA))
        objective = waves.objective(recorded, SIGMA, ["u: u**2", "v: 1"])
        noise = select(objective, objective.embed(z, []), [], silent).objective.noise
        assert (noise.count, objective.modes) == (21, 14)
        squares.append(float(noise.std[0] / SIGMA) ** 2)
    # The variance would be too large by (1 - 5/21)/(1 - 14/21) = 2.3 if every mode counted.
    assert sum(squares) / 10 == pytest.approx(1.0, abs=0.3)
