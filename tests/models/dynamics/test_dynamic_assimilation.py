"""Assimilation with dynamics: its loss, its fit, and what it leaves as it is."""

from __future__ import annotations

import copy
import math
from typing import TypeVar

import pytest
import torch
from torch import Tensor, nn

from dashred.data.observation_operator import ObservationOperator
from dashred.models.assimilation import AssimilationSensors
from dashred.models.dynamics import network_fit
from dashred.models.dynamics.basis_error import BasisError
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.network_assimilation import LEAST_ERROR, NetworkAssimilation
from dashred.models.dynamics.network_fit import NetworkFit
from dashred.models.dynamics.sampled_dynamics import EpisodeSteps, SampledDynamics
from dashred.models.dynamics.state_fit import FIRST_ERROR
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED, reconstruct
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.solvers.sample_step import SampleStep
from dashred.physics.solvers.simulate import simulate
from dashred.physics.terms.library import resolve
from datamodules import RecordingDataModule, WholeRecordingDataModule
from tests import ring
from tests.models.test_assimilation import FIT, INPUTS, LAGS, VALIDATE, fitted

A = TypeVar("A", bound=NetworkAssimilation)
NOISE = 0.05
BACKGROUND = 0.2


@pytest.fixture
def system(tmp_path):
    return ring.linear_system(tmp_path)


@pytest.fixture
def real(system) -> Tensor:
    """A field with a term that the simulator lacks, ``(time, field, x)``."""
    lawful = system.with_terms([(ring.library(system)[1], -0.3)])
    return simulate(lawful, ring.starts(system, 1, 7), ring.TIMES)[0]


@pytest.fixture
def data(system, real) -> RecordingDataModule:
    fit = ring.record(system, real).select(FIT)
    return RecordingDataModule(fit, ring.record(system, real, VALIDATE), INPUTS, LAGS, 16, 0)


def network(system, modes: int) -> SHRED:
    """Return a network that is not trained; seven modes represent every state exactly."""
    states = ring.ensemble(system, 12).states
    assert isinstance(states, Tensor)
    sensors = tuple(s for s in ring.SENSORS if s.name in INPUTS)
    scaler = Scaler.fit(ObservationOperator(sensors, system)(states))
    pod = POD.fit(states.flatten(0, 1), modes)
    spread = pod.encode(states).flatten(0, 1).std(dim=0)
    torch.manual_seed(0)
    return SHRED(scaler, pod, spread, 24, 1, [16]).float()


@pytest.fixture
def shred(system) -> SHRED:
    return network(system, 7)


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(network_fit, "ITERATIONS", 40)


def make(system, shred, data, *args, **changes) -> DynamicAssimilation:
    return built(DynamicAssimilation, system, shred, data, *args, **changes)


def built(
    kind: type[A],
    system,
    shred,
    data,
    adapter=True,
    is_over=lambda: False,
    background=BACKGROUND,
    unexpressed: BasisError | None = None,
) -> A:
    library = ring.library(system)
    dynamics = SampledDynamics(
        [EpisodeSteps(SampleStep(system, 0.1), ring.TIMES, 0)],
        [(term,) for term in resolve(system, library)],
        term_scales(system, library, ring.ensemble(system, 1).states[0], 0.0),
        shred.pod.scale,
        32,
    )
    torch.manual_seed(0)
    return kind(
        copy.deepcopy(shred),
        AssimilationSensors(
            ObservationOperator(data.fit.sensors, system),
            ObservationOperator(data.validation.sensors, system),
            torch.full((len(data.fit.sensors),), NOISE),
            torch.ones(len(data.fit.sensors)),
            torch.ones(len(data.validation.sensors)),
        ),
        32,
        0.01,
        data.windows,
        torch.full((1,), background),
        dynamics,
        unexpressed or BasisError(torch.zeros(len(data.fit.sensors)), 0.0, 0.0),
        adapter,
        is_over,
    )


def losses(
    module: DynamicAssimilation, data: RecordingDataModule, weight: float = 1.0
) -> dict[str, Tensor]:
    with torch.no_grad():
        latent = module.shred.encode(data.windows)
    return module.network_fit().losses(latent, data.fitted, FIRST_ERROR, weight)


def field_errors(shred, module, data, real) -> tuple[float, float]:
    """Return the errors of SHRED and of the assimilation in the real field."""
    before, after = (
        float((states - real).square().mean().sqrt())
        for states in (
            reconstruct(shred.encode, shred, data.windows),
            reconstruct(module.encoder, module.shred, data.windows),
        )
    )
    return before, after


def test_it_starts_as_shred(system, shred, data):
    module = make(system, shred, data)
    torch.testing.assert_close(
        reconstruct(module.encoder, module.shred, data.windows),
        reconstruct(shred.encode, shred, data.windows),
    )


def test_the_loss_is_the_one_of_its_formula(system, shred, data):
    module = make(system, shred, data)
    module.dynamics.set_law(torch.tensor([0, -0.1, 0, 0, 0, 0, 0, 0]).double())
    found = losses(module, data)
    fields = reconstruct(shred.encode, shred, data.windows)
    library = ring.library(system)
    lawful = system.with_terms([(library[1], -0.1)])
    forecast = simulate(lawful, fields[:-1], ring.TIMES[:2])[:, -1]
    scaled = (fields[1:] - forecast) / float(shred.pod.scale[0])
    read = module.sensors.fit
    expected = {
        "misfit": ((data.fitted - read(fields)) / NOISE).square().mean(),
        "forecast_misfit": ((data.fitted[1:] - read(forecast)) / NOISE).square().mean(),
        "step_error": scaled.square().mean() / FIRST_ERROR**2,
        "background": torch.zeros(()),
        "transform": torch.zeros(()),
    }
    for name, value in expected.items():
        assert float(found[name]) == pytest.approx(float(value), rel=1e-4, abs=1e-8)
    parts = [float(value) for name, value in found.items() if name != "train"]
    assert float(found["train"]) == pytest.approx(sum(parts))


def test_the_background_is_the_estimate_of_shred(system, shred, data):
    module = make(system, shred, data)
    last = module.encoder.transform.residual[-1]
    assert isinstance(last, nn.Linear)
    nn.init.constant_(last.bias, 0.1)
    first, later = (losses(module, data, weight)["background"] for weight in (1.0, 0.25))
    fields, guess = (
        reconstruct(encode, shred, data.windows) for encode in (module.encoder, shred.encode)
    )
    changes = (fields - guess) / (BACKGROUND * float(shred.pod.scale[0]))
    assert float(first) == pytest.approx(float(changes.square().mean()), rel=1e-4)
    assert float(later) == pytest.approx(float(first) / 4)


def test_an_estimate_without_error_leaves_the_loss_finite(system, shred, data):
    found = losses(make(system, shred, data, background=0.0), data)
    assert all(bool(value.isfinite()) for value in found.values())


def test_blocks_do_not_change_the_loss_or_its_gradient(system, shred, data):
    found = []
    for samples in (100, 7):
        module = make(system, shred, data)
        module.dynamics.at_once = samples
        module.dynamics.set_law(torch.tensor([0, -0.1, 0, 0, 0, 0, 0, 0]).double())
        loss = losses(module, data)["train"]
        gradients = [p.grad.double().flatten() for p in module.fitted if p.grad is not None]
        found.append((float(loss), torch.cat(gradients)))
    assert found[0][0] == pytest.approx(found[1][0], rel=1e-5)
    torch.testing.assert_close(found[0][1], found[1][1], rtol=1e-3, atol=1e-3)


def test_missing_readings_have_no_weight_and_no_gradient(system, shred, data):
    data.fitted[3:20, 1] = torch.nan
    module = make(system, shred, data)
    assert all(math.isfinite(float(value)) for value in losses(module, data).values())
    assert all(p.grad.isfinite().all() for p in module.fitted if p.grad is not None)


def test_the_fit_brings_the_field_nearer_to_the_real_one(system, shred, data, real):
    module = make(system, shred, data)
    module.dynamics.set_law(torch.tensor([0, -0.2, 0, 0, 0, 0, 0, 0]).double())
    frozen = copy.deepcopy(module.shred.state_dict())
    fitted(module, WholeRecordingDataModule(data), 3)
    before, after = field_errors(shred, module, data, real)
    assert after < 0.8 * before
    assert after < 0.2 * before
    changed = {n for n, v in module.shred.state_dict().items() if not torch.equal(v, frozen[n])}
    assert changed
    assert all(name.startswith("decoder.0.adapter") for name in changed)


def test_a_law_that_blows_up_is_dropped(system, shred, data):
    module = make(system, shred, data)
    library = [str(term) for term in ring.library(system)]
    law = torch.zeros(len(library)).double()
    law[library.index("u**3")] = 1e3
    module.dynamics.set_law(law)
    assert not losses(module, data)["train"].isfinite()
    trainer = fitted(module, WholeRecordingDataModule(data), 1)
    assert not module.dynamics.support.any()
    assert math.isfinite(float(trainer.callback_metrics["loss/train"]))
    assert all(bool(parameter.isfinite().all()) for parameter in module.fitted)


def test_a_field_that_blows_up_during_the_fit_is_not_kept(system, shred, data, monkeypatch):
    """The loss is not finite from the tenth evaluation on, as after a step that is too long."""
    module, calls = make(system, shred, data), []
    found = NetworkFit.losses

    def failing(self, latent, readings, error, weight):
        calls.append(error)
        if len(calls) > 10:
            with torch.no_grad():
                self.fitted[0].fill_(torch.nan)
        return found(self, latent, readings, error, weight)

    monkeypatch.setattr(NetworkFit, "losses", failing)
    trainer = fitted(module, WholeRecordingDataModule(data), 1)
    assert math.isfinite(float(trainer.callback_metrics["loss/train"]))
    assert all(bool(parameter.isfinite().all()) for parameter in module.fitted)
    assert module.fields(data.windows).isfinite().all()


def test_the_error_of_a_step_falls_only_when_the_steps_fit(system, shred, data):
    module = make(system, shred, data)
    trainer = fitted(module, WholeRecordingDataModule(data), 1)
    assert module.steps_fit == (float(trainer.callback_metrics["loss/step_error"]) <= 1)
    errors = [FIRST_ERROR]
    for epoch, fits in enumerate((False, False, True, True, True, True), start=1):
        module.steps_fit = fits
        module.error = module._next_error(epoch)
        errors.append(module.error)
    # The second epoch, which has another method, lowers it in any case.
    assert errors == pytest.approx([0.1, 0.03, 0.03, 0.009, 0.0027, 0.001, 0.001])


@pytest.mark.parametrize(("outside", "expected"), [(0.0, 0.03), (0.05, 0.05), (0.4, 0.1)])
def test_the_error_does_not_fall_below_what_the_basis_lacks(system, shred, data, outside, expected):
    module = make(system, shred, data)
    module.steps_fit, module.basis.outside = True, outside
    assert module._next_error(1) == pytest.approx(expected)


@pytest.mark.parametrize(("adapter", "expected"), [(True, 0.01), (False, 0.02)])
def test_the_steps_need_not_fit_better_than_their_numerical_error(
    system, shred, data, adapter, expected
):
    # Without an adapter, the basis cannot grow, and its error remains.
    readings = torch.full((len(data.fit.sensors),), 0.12)
    module = make(system, shred, data, adapter, unexpressed=BasisError(readings, 0.02, 0.01))
    assert module.least_error == expected
    torch.testing.assert_close(module.sensors.noise, torch.full_like(readings, 0.13))
    assert make(system, shred, data).least_error == LEAST_ERROR


@pytest.mark.parametrize(
    ("error", "fits", "same", "ends"),
    [
        (LEAST_ERROR, True, True, True),
        (LEAST_ERROR, False, True, False),
        (LEAST_ERROR, True, False, False),
        (0.01, True, True, False),
    ],
)
def test_the_fit_ends_when_neither_q_nor_the_terms_change(
    system, shred, data, monkeypatch, error, fits, same, ends
):
    module = make(system, shred, data)
    trainer = fitted(module, WholeRecordingDataModule(data), 2)
    trainer.should_stop = False
    monkeypatch.setattr(module, "log", lambda *_: None)
    module.steps_fit, module.error = fits, error
    module._support[0] = same == bool(module.dynamics.support[0])
    module.on_train_epoch_end()
    assert trainer.should_stop == ends


def test_readings_that_contradict_the_simulator_are_noticed(system, shred, data):
    module = make(system, shred, data)
    assert module.is_consistent
    fitted(module, WholeRecordingDataModule(data), 2)
    assert module.minimum is not None
    known, parts = module.minimum.loss.problem.count, module.minimum.fitted.parts
    assert known == int((~data.fitted.isnan()).sum())
    limit = 2 * (1 + 3 * math.sqrt(2 / known))
    for loss, expected in ((0.99 * limit, True), (1.01 * limit, False)):
        changed = module.minimum.fitted._replace(parts=parts | {"train": loss})
        module.minimum = module.minimum._replace(fitted=changed)
        assert module.is_consistent == expected


def test_a_basis_that_lacks_modes_gets_them(system, data, real):
    few = network(system, 4)
    module = make(system, few, data)
    before = copy.deepcopy(module.state_dict())
    fitted(module, WholeRecordingDataModule(data), 4)
    assert len(module.shred.spread) > 4
    assert module.shred.pod.left_out(real) < 0.5 * few.pod.left_out(real)
    fields = module.fields(data.windows)
    after = copy.deepcopy(module.state_dict())
    module.load_state_dict(before)
    assert len(module.shred.spread) == len(module.shred.pod.modes) == 4
    module.load_state_dict(after)
    assert torch.equal(module.fields(data.windows), fields)


def test_without_an_adapter_the_decoder_stays_bit_for_bit(system, shred, data):
    module = make(system, shred, data, adapter=False)
    before = copy.deepcopy(module.shred.state_dict())
    fitted(module, WholeRecordingDataModule(data), 1)
    after = module.shred.state_dict()
    assert all(torch.equal(after[name], before[name]) for name in before)


def test_the_fit_ends_when_the_time_is_up(system, shred, data):
    calls: list[int] = []

    def is_over() -> bool:
        calls.append(1)
        return True

    fitted(make(system, shred, data, is_over=is_over), WholeRecordingDataModule(data), 1)
    assert len(calls) == 1


def test_readings_that_shred_reads_are_compared_with_forecasts(system, shred, real):
    fit = ring.record(system, real).select(FIT)
    data = RecordingDataModule(fit, fit.between(2.0, 4.0), INPUTS, LAGS, 16, 0)
    module = make(system, shred, data)
    trainer = fitted(module, WholeRecordingDataModule(data), 1)
    with torch.no_grad():
        fields = module.shred.decode(module.encoder(data.windows)).double()
    read = module.sensors.fit(module.dynamics.forecasts(fields))
    error = (data.validated - read).square().nanmean().sqrt()
    found = float(trainer.callback_metrics["rmse/sensors_validate"])
    assert found == pytest.approx(float(error), rel=1e-3)
