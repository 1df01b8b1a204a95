"""The ensemble filter is the Kalman filter and smoother where the system is linear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.covariance_tapers import (
    distances,
    gaspari_cohn,
    sensor_distances,
)
from dashred.inference.initial_state.ensemble_filter import (
    FilterLostError,
    FilterResult,
    FilterSettings,
    ensemble_filter,
)
from dashred.inference.initial_state.serial_analysis import analyse, compile_analysis
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests.ring import SENSORS, linear_system

NOISE = torch.tensor([0.05, 0.1, 0.05, 0.2, 0.05, 0.1], dtype=torch.float64)
TIMES = 0.3 * torch.arange(5, dtype=torch.float64)
RANK = 7
FORCES = ("1", "sin(x)")


@dataclass(frozen=True)
class Gaussian:
    """The augmented vector (start, forces, present state), and the innovations of each sample."""

    mean: Tensor
    covariance: Tensor
    innovations: Tensor
    innovation_std: Tensor


@pytest.fixture
def system(tmp_path: Path) -> System:
    return linear_system(tmp_path)


def test_filter_and_smoother_are_exact_on_a_linear_system(system: System) -> None:
    case = Case(system, forced=False)
    found, exact = case.filtered(FilterSettings()), case.kalman()
    case.check(found, exact)


def test_the_filter_compiles_nothing_after_the_first_compilation(system: System) -> None:
    compile_analysis()
    before = len(analyse.nopython_signatures)
    Case(system, forced=True).filtered(FilterSettings())
    assert len(analyse.nopython_signatures) == before


def test_coefficients_of_a_forcing_are_the_joint_kalman_estimate(system: System) -> None:
    case = Case(system, forced=True)
    found, exact = case.filtered(FilterSettings()), case.kalman()
    case.check(found, exact)
    n = case.points
    coefficients = found.coefficients_anomalies
    torch.testing.assert_close(found.coefficients_mean, exact.mean[n : n + 2], rtol=0, atol=1e-8)
    found_covariance = coefficients.T @ coefficients / (len(coefficients) - 1)
    wanted = exact.covariance[n : n + 2, n : n + 2]
    torch.testing.assert_close(found_covariance, wanted, rtol=0, atol=1e-8)
    assert float(wanted.trace()) < 0.5 * 2  # the record contains information on the forces


def test_missing_values_are_skipped(system: System) -> None:
    case = Case(system, forced=True)
    values = case.values.clone()
    values[1], values[2, 3], values[:, 5] = torch.nan, torch.nan, torch.nan
    case = replace_values(case, values)
    found = case.filtered(FilterSettings())
    case.check(found, case.kalman())
    assert torch.equal(found.innovations.isnan(), values.isnan())


def test_innovations_and_their_expected_size_are_the_kalman_filters(system: System) -> None:
    case = Case(system, forced=True)
    found, exact = case.filtered(FilterSettings()), case.kalman()
    torch.testing.assert_close(found.innovations, exact.innovations, rtol=0, atol=1e-8)
    torch.testing.assert_close(found.innovation_std, exact.innovation_std, rtol=0, atol=1e-8)


def test_damping_reduces_the_update_of_the_coefficients(system: System) -> None:
    case = Case(system, forced=True)
    whole, none = case.filtered(FilterSettings()), case.filtered(FilterSettings(damping=0.0))
    torch.testing.assert_close(none.coefficients_mean, torch.zeros(2, dtype=torch.float64))
    assert float(whole.coefficients_mean.norm()) > 0.1


def test_inflation_grows_the_spread(system: System) -> None:
    case = Case(system, forced=False)
    plain = case.filtered(FilterSettings())
    inflated = case.filtered(FilterSettings(inflation=1.2))
    assert float(inflated.anomalies.norm()) > 1.05 * float(plain.anomalies.norm())
    assert torch.all(inflated.innovation_std > plain.innovation_std)


def test_localisation_improves_a_small_ensemble(system: System) -> None:
    generator = torch.Generator().manual_seed(3)
    x = system.grid.coordinates["x"]
    apart = (x[:, None] - x + math.pi).remainder(2 * math.pi) - math.pi
    root = torch.linalg.cholesky(gaspari_cohn(apart.abs(), 0.5) + 1e-9 * torch.eye(32))
    operator = ObservationOperator(SENSORS, system)
    errors = []
    for _ in range(20):
        draws = torch.randn(13, 32, generator=generator, dtype=torch.float64) @ root.T
        truth, members = draws[0], draws[1:, None]
        noise = 0.1 * torch.ones(6, dtype=torch.float64)
        values = operator(truth[None]) + 0.1 * torch.randn(6, generator=generator)
        errors.append(
            [
                float((found.mean[0] - truth).norm() + (found.start_mean[0] - truth).norm())
                for settings in (FilterSettings(), FilterSettings(radius=0.5, start_radius=0.5))
                for found in [
                    ensemble_filter(
                        system,
                        members,
                        None,
                        (),
                        TIMES[:1],
                        values[None],
                        operator,
                        noise,
                        settings,
                    )
                ]
            ]
        )
    plain, localised = torch.tensor(errors).mean(dim=0).tolist()
    assert localised < 0.8 * plain


def test_members_that_blow_up_are_left_out(system: System) -> None:
    case = Case(system, forced=True)
    growth = Term("u", system.parse("u**3", "library.u", equation="u"))
    coefficients = torch.zeros(len(case.members), 1, dtype=torch.float64)
    coefficients[:3] = 1e6
    # Without damping, the first analysis would spread the extreme coefficients to all members.
    held = FilterSettings(damping=0.0)
    found = run(case, (growth,), coefficients, held)
    assert len(found.anomalies) == len(case.members) - 3
    assert torch.isfinite(found.start_mean).all()
    with pytest.raises(FilterLostError, match="only 0 of 18 members have not blown up"):
        run(case, (growth,), torch.full_like(coefficients, 1e6), held)


def test_members_that_are_about_to_blow_up_are_left_out_too(system: System) -> None:
    case = Case(system, forced=True)
    growth = Term("u", system.parse("u", "library.u", equation="u"))
    coefficients = torch.zeros(len(case.members), 1, dtype=torch.float64)
    # e³⁴⁵ = 1e150 after one step: finite, but not its square.
    coefficients[:3] = 345 / float(TIMES[1] - TIMES[0])
    found = run(case, (growth,), coefficients, FilterSettings(damping=0.0))
    assert len(found.anomalies) == len(case.members) - 3
    assert torch.isfinite(found.start_mean).all()


def test_the_taper_is_one_at_the_sensor_and_zero_far_away() -> None:
    distance = torch.linspace(0, 3, 301, dtype=torch.float64)
    taper = gaspari_cohn(distance, 1.0)
    assert float(taper[0]) == 1.0
    assert float(taper[100]) == pytest.approx(5 / 24)
    assert torch.all(taper[200:].abs() < 1e-12)
    assert torch.all(taper.diff() < 1e-12)


def test_distances_go_around_the_ring(system: System) -> None:
    places = torch.tensor([[0.1], [2 * math.pi - 0.1]], dtype=torch.float64)
    x = system.grid.coordinates["x"]
    assert float(sensor_distances(system.grid, places)[0, 1]) == pytest.approx(0.2)
    found = distances(system.grid, places)
    assert float(found[1, 0]) == pytest.approx(0.1)
    assert float(found.max()) <= math.pi
    assert float(found[0, 8]) == pytest.approx(float(x[8]) - 0.1)


class Case:
    """A ring with a Gaussian prior of low rank, as an ensemble and as matrices."""

    def __init__(self, system: System, forced: bool, seed: int = 0) -> None:
        generator = torch.Generator().manual_seed(seed)
        self.system, self.points = system, system.grid.shape[0]
        self.operator = ObservationOperator(SENSORS, system)
        self.terms = [
            Term("u", system.parse(text, "library.u", equation="u"))
            for text in (FORCES if forced else ())
        ]
        self.mean = torch.cat([torch.sin(system.grid.coordinates["x"]), torch.zeros(len(FORCES))])
        self.mean = self.mean[: self.points + len(self.terms)].double()
        modes = torch.randn(RANK, self.points, generator=generator, dtype=torch.float64)
        modes = torch.cat([modes, torch.zeros(len(self.terms), self.points)])
        forces = torch.cat([torch.zeros(RANK, len(self.terms)), torch.eye(len(self.terms))])
        self.modes = torch.cat([modes, forces], dim=1)
        # Pairs ±: the sample mean and covariance equal those of the prior.
        size = ((2 * len(self.modes) - 1) / 2) ** 0.5
        joint = self.mean + size * torch.cat([self.modes, -self.modes])
        self.members = joint[:, None, : self.points]
        self.coefficients = joint[:, self.points :]
        drawn = torch.randn(len(self.modes), generator=generator, dtype=torch.float64)
        truth = self.mean + drawn @ self.modes
        path = self.run(truth[None, : self.points], truth[None, self.points :], TIMES)[0]
        noise = torch.randn(len(TIMES), len(NOISE), generator=generator, dtype=torch.float64)
        self.values = self.operator(path[:, None]) + NOISE * noise

    def run(self, states: Tensor, forces: Tensor, times: Tensor) -> Tensor:
        """Return trajectories ``(batch, time, point)``."""
        forcing = Forcing(tuple(self.terms), forces)
        return simulate(self.system, states[:, None], times, forcing)[:, :, 0]

    def filtered(self, settings: FilterSettings) -> FilterResult:
        """Return the filter's result."""
        return run(self, self.terms, self.coefficients, settings)

    def kalman(self) -> Gaussian:
        """Return the exact filter of the augmented vector, sample by sample."""
        n, p = self.points, len(self.terms)
        step = self.matrix(TIMES[:2])
        prior = self.modes.T @ self.modes
        mean = torch.cat([self.mean, self.mean[:n]])
        lift = torch.cat([torch.eye(n + p), torch.eye(n, n + p)]).double()
        covariance = lift @ prior @ lift.T
        transition = torch.eye(2 * n + p, dtype=torch.float64)
        transition[n + p :] = 0
        transition[n + p :, n : n + p] = step[:, n:]
        transition[n + p :, n + p :] = step[:, :n]
        reads = self.operator(torch.eye(n, dtype=torch.float64)[:, None]).T
        whole = torch.cat([torch.zeros(len(NOISE), n + p), reads], dim=1)
        innovations, variances = [], []
        for i, values in enumerate(self.values):
            if i:
                mean, covariance = transition @ mean, transition @ covariance @ transition.T
            innovations.append(values - whole @ mean)
            variances.append((whole @ covariance @ whole.T).diagonal() + NOISE**2)
            known = ~values.isnan()
            h, r = whole[known], torch.diag(NOISE[known] ** 2)
            gain = torch.linalg.solve(h @ covariance @ h.T + r, h @ covariance).T
            mean = mean + gain @ (values[known] - h @ mean)
            covariance = covariance - gain @ h @ covariance
        stds = torch.stack(variances).sqrt()
        return Gaussian(mean, covariance, torch.stack(innovations), stds)

    def matrix(self, times: Tensor) -> Tensor:
        """Return the matrix from state and forces to the state one sample later."""
        n, p = self.points, len(self.terms)
        unit = torch.eye(n + p, dtype=torch.float64)
        return self.run(unit[:, :n], unit[:, n:], times)[:, -1].T

    def check(self, found: FilterResult, exact: Gaussian) -> None:
        """Compare means and covariances of the start and of the present state."""
        n, p = self.points, len(self.terms)
        for mean, anomalies, part in (
            (found.start_mean, found.start_anomalies, slice(n)),
            (found.mean, found.anomalies, slice(n + p, None)),
        ):
            torch.testing.assert_close(mean[0], exact.mean[part], rtol=0, atol=1e-8)
            flat = anomalies.flatten(1)
            covariance = flat.T @ flat / (len(flat) - 1)
            torch.testing.assert_close(covariance, exact.covariance[part, part], rtol=0, atol=1e-8)


def replace_values(case: Case, values: Tensor) -> Case:
    case.values = values
    return case


def run(
    case: Case,
    terms: tuple[Term, ...] | list[Term],
    coefficients: Tensor,
    settings: FilterSettings,
) -> FilterResult:
    return ensemble_filter(
        case.system,
        case.members,
        coefficients,
        terms,
        TIMES,
        case.values,
        case.operator,
        NOISE,
        settings,
    )
