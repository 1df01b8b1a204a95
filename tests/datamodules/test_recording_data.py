"""The data module of a recording gives sensor values, never a field."""

from __future__ import annotations

import inspect
from typing import Any

import numpy as np
import pytest
import torch
from lightning import LightningDataModule

from dashred.config.schema.recording import SensorSplit, Splits, TimeSplit
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.splits import split_recording
from datamodules import RecordingDataModule

LAGS, SAMPLES = 5, 60


def record(names: tuple[str, ...], samples: int = SAMPLES) -> Recording:
    """Return one sine per sensor."""
    times = 0.1 * np.arange(samples, dtype=np.float64)
    sensors = tuple(Sensor(name, "u", (0.3 * i,)) for i, name in enumerate(names))
    values = np.stack([np.sin(times * (1 + 0.2 * i) + i) for i in range(len(names))], axis=1)
    return Recording(sensors, times, values)


@pytest.fixture
def fit() -> Recording:
    return record(("a", "b", "c", "d"))


@pytest.fixture
def validation() -> Recording:
    return record(("v", "w"))


def make(fit: Recording, validation: Recording, **changed: Any) -> RecordingDataModule:
    settings: dict[str, Any] = {"inputs": ("a", "c"), "lags": LAGS, "batch": 8, "seed": 0} | changed
    return RecordingDataModule(fit, validation, **settings)


def arrays(value: Any, depth: int = 0) -> list[tuple[int, ...]]:
    """Return the shapes of all arrays reachable from a value."""
    if isinstance(value, torch.Tensor | np.ndarray):
        return [tuple(value.shape)]
    if isinstance(value, dict):
        return [s for item in value.values() for s in arrays(item, depth)]
    if isinstance(value, list | tuple):
        return [s for item in value for s in arrays(item, depth)]
    if depth < 4 and hasattr(value, "__dict__"):
        return [s for item in vars(value).values() for s in arrays(item, depth + 1)]
    return []


def test_no_field_is_available(fit, validation):
    """Every reachable array has a time and a sensor dimension, and no grid dimension."""
    data = make(fit, validation)
    allowed = {
        (SAMPLES,),
        (SAMPLES, 4),
        (SAMPLES, 2),
        (SAMPLES, LAGS + 1, 2),
        *((1,), (1, 1), (0,)),  # clock, values and jumps of the inputs, all empty
    }
    own = set(vars(data))
    shapes = arrays({name: getattr(data, name) for name in own})
    assert len(shapes) >= 5
    assert set(shapes) <= allowed
    added = {name for name in dir(data) if name not in dir(LightningDataModule())}
    assert added == {
        "batch", "fit", "fitted", "seed", "validated", "validation", "windows",
    }  # fmt: skip
    for loader in (data.train_dataloader(), data.val_dataloader()):
        for batch in loader:
            assert {t.shape[1:] for t in batch} <= {(LAGS + 1, 2), (4,), (2,)}


def test_it_is_built_from_values_alone(fit, validation):
    """Neither a simulator nor a state is among the arguments."""
    parameters = inspect.signature(RecordingDataModule.__init__).parameters
    kinds = {name: p.annotation for name, p in parameters.items() if name != "self"}
    values = {"Recording", "tuple[Recording, ...]"}
    assert set(kinds.values()) == {*values, "tuple[str, ...]", "int"}


def test_windows_end_with_what_the_inputs_read(fit, validation):
    data = make(fit, validation)
    expected = torch.from_numpy(fit.values[:, [0, 2]]).float()
    assert torch.equal(data.windows[:, -1], expected)
    assert torch.equal(data.windows[20, 0], expected[20 - LAGS])
    assert torch.equal(data.fitted, torch.from_numpy(fit.values).float())
    assert torch.equal(data.validated, torch.from_numpy(validation.values))


def test_a_gap_is_bridged_in_histories_and_left_out_of_targets(fit, validation):
    fit.values[10:14, 2] = np.nan
    data = make(fit, validation)
    assert data.windows.isfinite().all()
    assert data.fitted[10:14, 2].isnan().all()
    assert int(data.fitted.isnan().sum()) == 4


def test_where_no_sensor_validates_the_validating_stretch_is_not_fitted(fit):
    later = fit.between(fit.times[48], fit.times[-1])
    data = make(fit, later)
    assert data.fitted[48:].isnan().all()
    assert not data.fitted[:48].isnan().any()
    assert data.validated[:48].isnan().all()
    assert torch.equal(data.validated[48:], torch.from_numpy(fit.values[48:]))
    fitted = torch.cat([batch[1] for batch in data.train_dataloader()])
    assert int((~fitted.isnan()).any(dim=1).sum()) == 48


def test_a_missing_sample_of_the_validating_stretch_is_not_fitted_either(fit):
    values = fit.values.copy()
    values[50, 1] = np.nan
    gappy = Recording(fit.sensors, fit.times, values)
    data = make(gappy, gappy.between(fit.times[48], fit.times[-1]))
    assert data.fitted[48:].isnan().all()


@pytest.mark.parametrize("count", [4, 9])
def test_held_out_sensors_and_times_are_not_used(count):
    whole = record(tuple(f"s{i}" for i in range(count)), 100)
    splits = Splits(SensorSplit(validate=2, test=2, extra=1), TimeSplit(test=0.2))
    split = split_recording(whole, splits, seed=1)
    data = make(split.fit, split.validation, inputs=split.inputs)
    assert data.fitted.shape == (80, len(split.inputs) + len(split.extra))
    unseen = {*split.test}
    assert not unseen & {*data.fit.names, *data.validation.names}
    assert data.fit.times[-1] == split.time_end
    if split.validate:
        assert not {*split.validate} & {*data.fit.names}
    # Changing the test values has no effect.
    values = whole.values.copy()
    values[:, [whole.names.index(name) for name in split.test]] = 1e6
    values[80:] = -1e6
    other = split_recording(Recording(whole.sensors, whole.times, values), splits, seed=1)
    again = make(other.fit, other.validation, inputs=other.inputs)
    for name in ("windows", "fitted", "validated"):
        torch.testing.assert_close(
            getattr(again, name), getattr(data, name), equal_nan=True, rtol=0, atol=0
        )


def test_batches_are_repeatable_by_seed(fit, validation):
    first, again, other = (
        [batch[0] for batch in make(fit, validation, seed=seed).train_dataloader()]
        for seed in (1, 1, 2)
    )
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not torch.equal(first[0], other[0])


def test_windows_and_values_of_a_batch_are_of_one_time(fit, validation):
    data = make(fit, validation)
    for seen, values in data.train_dataloader():
        assert torch.equal(seen[:, -1], values[:, [0, 2]])
    seen, values, validated = (
        torch.cat(parts) for parts in zip(*data.val_dataloader(), strict=True)
    )
    assert torch.equal(values, data.fitted)
    assert torch.equal(validated, data.validated.float())
    assert torch.equal(seen, data.windows)
