"""Assimilation: trained and frozen parts, and the loss."""

from __future__ import annotations

import copy

import pytest
import torch
from lightning import LightningDataModule, Trainer, seed_everything
from torch import Tensor

from callbacks import BestState, RMSECurves
from dashred.data.observation_operator import ObservationOperator
from dashred.models.assimilation import Assimilation, AssimilationSensors, LatentTransform
from dashred.models.shred import SHRED, reconstruct
from dashred.physics.solvers.simulate import simulate
from datamodules import RecordingDataModule
from tests import ring

LAGS = 6
INPUTS = ("s0", "s1", "s3", "s5")
FIT, VALIDATE = ("s0", "s1", "s3", "s4", "s5"), ring.SENSORS[2:3]


def ignore(metrics, step):
    """Log nothing."""


@pytest.fixture
def system(tmp_path):
    return ring.linear_system(tmp_path)


@pytest.fixture
def real(system) -> Tensor:
    """A field with a term that the simulator lacks, ``(time, field, x)``."""
    term = ring.library(system)[ring.LIBRARY.index("d(u, x)")]
    lawful = system.with_terms([(term, -0.3)])
    return simulate(lawful, ring.starts(system, 1, 7), ring.TIMES)[0]


@pytest.fixture
def data(system, real) -> RecordingDataModule:
    fit = ring.record(system, real).select(FIT)
    validation = ring.record(system, real, VALIDATE)
    return RecordingDataModule(fit, validation, INPUTS, LAGS, 16, 0)


@pytest.fixture
def shred(system) -> SHRED:
    states = ring.ensemble(system, 12).states
    sensors = tuple(s for s in ring.SENSORS if s.name in INPUTS)
    return ring.untrained(states, ObservationOperator(sensors, system)).float()


def make(system, shred: SHRED, data: RecordingDataModule, **changed) -> Assimilation:
    count = len(data.fit.sensors)
    settings = {"width": 16, "penalty": 0.01, "rate": 1e-2, "encoder_rate": 0.0} | changed
    torch.manual_seed(0)
    return Assimilation(
        copy.deepcopy(shred),
        AssimilationSensors(
            ObservationOperator(data.fit.sensors, system),
            ObservationOperator(data.validation.sensors, system),
            torch.full((count,), 0.1),
            torch.ones(count),
            torch.ones(len(data.validation.sensors)),
        ),
        **settings,
    )


def fitted(module: Assimilation, data: LightningDataModule, epochs: int, *callbacks) -> Trainer:
    seed_everything(0, verbose=False)
    trainer = Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        num_sanity_val_steps=-1,
        callbacks=list(callbacks),
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        enable_model_summary=False,
    )
    trainer.fit(module, data)
    return trainer


def moved(module: Assimilation, before: dict[str, Tensor], prefix: str = "") -> set[str]:
    """Return the parts of SHRED whose state has changed."""
    return {
        name.partition(".")[0]
        for name, value in module.shred.state_dict().items()
        if name.startswith(prefix) and not torch.equal(value, before[name])
    }


def test_the_transform_starts_as_the_identity(system, shred, data):
    latent = torch.randn(7, 24)
    assert torch.equal(LatentTransform(24, 16)(latent), latent)
    module = make(system, shred, data)
    assert torch.equal(
        reconstruct(module.encoder, module.shred, data.windows),
        reconstruct(shred.encode, shred, data.windows),
    )


@pytest.mark.parametrize(("rate", "expected"), [(0.0, set()), (1e-3, {"encoder"})])
def test_the_decoder_the_basis_and_the_scaler_stay_bit_for_bit(system, shred, data, rate, expected):
    module = make(system, shred, data, encoder_rate=rate)
    before = copy.deepcopy(module.shred.state_dict())
    transform = copy.deepcopy(module.encoder.transform.state_dict())
    fitted(module, data, 3)
    assert moved(module, before) == expected
    after = module.encoder.transform.state_dict()
    assert not any(torch.equal(after[name], transform[name]) for name in transform)


def test_only_trained_parameters_are_given_to_the_optimiser(system, shred, data):
    frozen = make(system, shred, data)
    names = {name for name, p in frozen.named_parameters() if p.requires_grad}
    assert all(name.startswith("encoder.transform") for name in names)
    [group] = frozen.configure_optimizers().param_groups
    assert len(group["params"]) == len(names) == 4
    following = make(system, shred, data, encoder_rate=1e-4).configure_optimizers()
    assert [group["lr"] for group in following.param_groups] == [1e-2, 1e-4]


def test_fitting_lowers_the_misfit_to_the_sensors(system, shred, data):
    module = make(system, shred, data)
    curves = RMSECurves(ignore, ignore, "assimilate")
    fitted(module, data, 15, curves)
    misfit = [value for _, value in curves.history["loss/misfit"]]
    assert misfit[-1] < 0.7 * misfit[0]
    rmse = [value for _, value in curves.history["rmse/sensors_fit"]]
    assert rmse[-1] < 0.9 * rmse[0]


def test_a_heavy_penalty_holds_the_transform_at_zero(system, shred, data):
    free, held = (make(system, shred, data, penalty=p) for p in (0.0, 1e6))
    sizes = []
    for module in (free, held):
        fitted(module, data, 5)
        with torch.no_grad():
            latent = module.shred.encode(data.windows)
            sizes.append(float((module.encoder.transform(latent) - latent).square().mean()))
    assert sizes[1] < 1e-2 * sizes[0]


def loss(module: Assimilation, seen: Tensor, values: Tensor) -> Tensor:
    module.log = lambda *args, **kwargs: None  # type: ignore[method-assign]
    return module.training_step((seen, values), 0)


def test_missing_values_carry_no_weight(system, shred, data):
    module = make(system, shred, data)
    seen, values = data.windows, data.fitted
    gappy = values.clone()
    gappy[3:20, 1] = torch.nan
    gappy[:, 4] = torch.nan
    with torch.no_grad():
        read = module.sensors.fit(module.shred.decode(module.encoder(seen)))
    known = ~gappy.isnan()
    expected = (((gappy - read) / 0.1)[known] ** 2).mean()
    found = loss(module, seen, gappy)
    torch.testing.assert_close(found, expected)
    found.backward()
    gradients = [p.grad for p in module.encoder.transform.parameters() if p.grad is not None]
    assert gradients
    assert all(g.isfinite().all() for g in gradients)
    # A value in place of the gap has weight.
    gappy[5, 1] = 100.0
    assert loss(module, seen, gappy) > 2 * expected


def test_nothing_recorded_is_no_error(system, shred, data):
    module = make(system, shred, data)
    assert loss(module, data.windows, torch.full_like(data.fitted, torch.nan)) == 0.0


def test_noisier_sensors_count_less(system, shred, data):
    module = make(system, shred, data)
    plain = loss(module, data.windows, data.fitted)
    module.sensors.noise *= 10
    torch.testing.assert_close(100 * loss(module, data.windows, data.fitted), plain)


def test_the_rmse_is_over_all_recorded_samples(system, shred, data):
    """Batches have the weight of their recorded values, in units of each sensor's scale."""
    data.fitted[2:40:3, 2] = torch.nan
    data.batch = 7
    module = make(system, shred, data)
    module.sensors.fit_scale *= 2
    trainer = fitted(module, data, 1)
    metrics = trainer.callback_metrics
    with torch.no_grad():
        field = module.shred.decode(module.encoder(data.windows))
    for name, values, operator, scale in (
        ("fit", data.fitted, module.sensors.fit, 2.0),
        ("validate", data.validated.float(), module.sensors.validation, 1.0),
    ):
        error = ((values - operator(field)) / scale).square().nanmean().sqrt()
        assert float(metrics[f"rmse/sensors_{name}"]) == pytest.approx(float(error), rel=1e-3)


def test_the_best_state_is_restored_and_the_one_before_training_counts(system, shred, data):
    module = make(system, shred, data, rate=0.5)
    before = copy.deepcopy(module.state_dict())
    # The validation sensors read exactly SHRED's estimate, which cannot be improved.
    field = reconstruct(shred.encode, shred, data.windows)
    with torch.no_grad():
        data.validated = module.sensors.validation(field)
    best = BestState("rmse/sensors_validate")
    fitted(module, data, 3, best)
    assert best.best_epoch == 0
    assert best.best == pytest.approx(0.0, abs=1e-5)
    after = module.state_dict()
    assert all(torch.equal(after[name], before[name]) for name in before)
