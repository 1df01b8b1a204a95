"""Splits of a recording: sensor roles and the held-out end of the time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.config import Splits
from dashred.core.errors import InputError, nearest
from dashred.data.recording import Recording
from dashred.data.sensor_spacing import farthest_points
from dashred.data.sensors import check_names

# A separate random stream, so that no other use of the seed changes the roles of the sensors.
RNG_STREAM = 0x5E25
# No more sensors are drawn to be held out than leave this many to be fitted.
MIN_FITTED = 4
# With at least this many fit sensors, a third of them is kept from SHRED's input by default.
MIN_SENSORS_FOR_EXTRA = 6
# Share, and minimum number, of the samples of a held-out episode that determine its start.
START_FRACTION, MIN_START_SAMPLES = 0.1, 6


@dataclass(frozen=True)
class Split:
    """Roles of the sensors and the corresponding parts of the recording.

    Attributes:
        inputs: fit sensors that are SHRED's input.
        extra: fit sensors that are used by assimilation only.
        validate: sensors for early stopping and model selection.
        test: sensors that are not used until discovery is final.
        fit: inputs and extra, up to ``time_end``.
        validation: validate sensors up to ``time_end``; without validate sensors, the fit sensors
            after ``fit_end``.
        heldout: fit and validate sensors after ``time_end``.
        tested: test sensors at all times.
        time_end: time of the last sample that is not held out.
        fit_end: time of the last sample that may be fitted: ``time_end``, or earlier if the
            rest of the fit window is used for validation.
        note: one sentence on the held-out data.
    """

    inputs: tuple[str, ...]
    extra: tuple[str, ...]
    validate: tuple[str, ...]
    test: tuple[str, ...]
    fit: Recording
    validation: Recording
    heldout: Recording
    tested: Recording
    time_end: float
    fit_end: float
    note: str

    def each(self, change: Callable[[Recording], Recording]) -> Split:
        """Return the split with every part of the recording changed."""
        return replace(
            self,
            fit=change(self.fit),
            validation=change(self.validation),
            heldout=change(self.heldout),
            tested=change(self.tested),
        )

    @property
    def roles(self) -> dict[str, str]:
        """The role of every sensor: input, extra, validate or test."""
        parts = {
            "test": self.test,
            "validate": self.validate,
            "extra": self.extra,
            "input": self.inputs,
        }
        return {name: role for role, names in parts.items() for name in names}


def split_recording(recording: Recording, splits: Splits, seed: int) -> Split:
    """Assign a role to every sensor and split the time.

    Where ``splits.sensors`` gives a number, that many sensors are drawn with the seed, spread
    over the domain, but at least 4 are fitted; where it gives names, those sensors are taken.

    Raises:
        InputError: a named sensor does not exist or has two roles, or no input sensor is left.
    """
    rng = np.random.default_rng([seed, RNG_STREAM])
    validate, test = _held_out(recording, splits, rng)
    fitted = [name for name in recording.names if name not in (*validate, *test)]
    extra = _extra(recording, fitted, splits.sensors.extra, rng)
    times = recording.times
    last = _last_fit_index(times, splits.time.test)
    early = recording.between(times[0], times[last])
    # Without validate sensors, the last fifth of the fit window is used for validation.
    fit_last = last if validate else _last_fit_index(times[: last + 1], 0.2)
    if validate:
        validation = early.select(validate)
    else:
        validation = early.select(fitted).between(times[fit_last + 1], times[last])
    return Split(
        inputs=tuple(name for name in fitted if name not in extra),
        extra=extra,
        validate=validate,
        test=test,
        fit=early.select(fitted),
        validation=validation,
        heldout=recording.between(times[last + 1], times[-1]).select([*fitted, *validate]),
        tested=recording.select(test),
        time_end=float(times[last]),
        fit_end=float(times[fit_last]),
        note=_note(recording, splits, validate, test, float(times[fit_last]), float(times[last])),
    )


def check_read(splits: Sequence[Split]) -> None:
    """Check that every sensor has a value before the held-out time of one episode at least.

    Raises:
        InputError: one has none.
    """
    for name, role in splits[0].roles.items():
        if not any(_is_read(split, name, role) for split in splits):
            problem = f"sensor {name!r} has no value until t = {splits[0].time_end:.6g}"
            hint = "leave it out: recording.ignore=[NAME], or lower splits.time.test"
            raise InputError(problem, hint=hint)


def _is_read(split: Split, name: str, role: str) -> bool:
    part = {"test": split.tested, "validate": split.validation}.get(role, split.fit)
    early = part.select([name]).between(part.times[0], split.time_end)
    return not np.isnan(early.values).all()


def hold_out_episode(recording: Recording, split: Split) -> Split:
    """Return the split of an entirely held-out episode; its first tenth determines its start.

    Args:
        recording: the episode.
        split: the split of the episode if it were fitted; the sensors keep their roles.
    """
    times = recording.times
    last = max(_last_fit_index(times, 1 - START_FRACTION), MIN_START_SAMPLES - 1)
    early, late = (
        recording.between(times[0], times[last]),
        recording.between(times[last + 1], times[-1]),
    )
    return replace(
        split,
        fit=early.select(split.fit.names),
        validation=early.select(split.validation.names),
        heldout=late.select([*split.fit.names, *split.validate]),
        tested=recording.select(split.test),
        time_end=float(times[last]),
        fit_end=float(times[last]),
        note=f"Entirely held out; its start is fitted until t = {times[last]:.6g}.",
    )


def _held_out(
    recording: Recording, splits: Splits, rng: np.random.Generator
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    named = {"validate": splits.sensors.validate, "test": splits.sensors.test}
    roles = {role: _named(recording, role, wanted) for role, wanted in named.items()}
    check_names([*roles["validate"], *roles["test"]], "splits.sensors")
    counts = _counts(recording, splits)
    taken = [recording.names.index(name) for names in roles.values() for name in names]
    left = [index for index in range(len(recording.sensors)) if index not in taken]
    if not left:
        raise _too_few(recording)
    # The gain of a sensor is determined by its own readings.
    free = [index for index in left if not recording.sensors[index].is_calibrated]
    drawn = farthest_points(
        _positions(recording), sum(counts.values()), rng, candidates=free, already_chosen=taken
    )
    # The first points drawn are the farthest apart: shuffle, so that this favours neither role.
    shuffled = [recording.names[index] for index in rng.permutation(np.array(drawn, dtype=int))]
    validate = {*roles["validate"], *shuffled[: counts["validate"]]}
    test = {*roles["test"], *shuffled[counts["validate"] :]}
    return _ordered(recording, validate), _ordered(recording, test)


def _named(recording: Recording, role: str, wanted: Any) -> list[str]:
    if isinstance(wanted, int):
        return []
    for name in wanted:
        if name not in recording.names:
            problem = f"the recording has no sensor {name!r}"
            hint = nearest(str(name), recording.names)
            raise InputError(problem, where=f"splits.sensors.{role}", hint=hint)
        if recording.sensors[recording.names.index(name)].is_calibrated:
            problem = f"sensor {name!r} cannot be held out, because its calibration is fitted"
            hint = f"remove it from recording.calibration or from splits.sensors.{role}"
            raise InputError(problem, where=f"splits.sensors.{role}", hint=hint)
    return list(wanted)


def _counts(recording: Recording, splits: Splits) -> dict[str, int]:
    """Return how many sensors are drawn for each role; few sensors keep the ratio of the roles."""
    wanted = {"validate": splits.sensors.validate, "test": splits.sensors.test}
    numbers = {role: value if isinstance(value, int) else 0 for role, value in wanted.items()}
    named = sum(0 if isinstance(value, int) else len(value) for value in wanted.values())
    total = sum(numbers.values())
    fixed = max(MIN_FITTED, sum(sensor.is_calibrated for sensor in recording.sensors))
    most = max(0, len(recording.sensors) - named - fixed)
    if total <= most:
        return numbers
    test = round(most * numbers["test"] / total)
    return {"validate": most - test, "test": test}


def _too_few(recording: Recording) -> InputError:
    problem = f"all {len(recording.sensors)} sensors are held out"
    hint = "name fewer in splits.sensors.validate or splits.sensors.test: at least one is fitted"
    return InputError(problem, where="splits.sensors", hint=hint)


def _extra(
    recording: Recording, fitted: list[str], wanted: int | None, rng: np.random.Generator
) -> tuple[str, ...]:
    default = len(fitted) // 3 if len(fitted) >= MIN_SENSORS_FOR_EXTRA else 0
    count = default if wanted is None else wanted
    if count >= len(fitted):
        problem = f"{count} extra sensors leave none of the {len(fitted)} fit sensors for SHRED"
        hint = f"set it to {len(fitted) - 1} or less"
        raise InputError(problem, where="splits.sensors.extra", hint=hint)
    candidates = [recording.names.index(name) for name in fitted]
    drawn = farthest_points(_positions(recording), count, rng, candidates=candidates)
    return _ordered(recording, {recording.names[index] for index in drawn})


def _last_fit_index(times: NDArray[np.float64], fraction: float) -> int:
    end = times[0] + (1.0 - fraction) * (times[-1] - times[0])
    # The end may coincide with a sample; the tolerance makes the result independent of rounding.
    rounding = 1e-9 * (times[-1] - times[0])
    count = int(np.searchsorted(times, end + rounding, side="right"))
    return min(count, len(times) - 1) - 1


def _positions(recording: Recording) -> NDArray[np.float64]:
    return np.array([sensor.position for sensor in recording.sensors], dtype=np.float64)


def _ordered(recording: Recording, names: set[str]) -> tuple[str, ...]:
    return tuple(name for name in recording.names if name in names)


def _note(
    recording: Recording,
    splits: Splits,
    validate: Sequence[str],
    test: Sequence[str],
    fit_end: float,
    time_end: float,
) -> str:
    count = len(recording.sensors)
    fitted = count - len(validate) - len(test)
    held = f"t > {time_end:.6g} is held out"
    sensors = f"{fitted} of {count} sensors are fitted"
    if not test:
        held += ", no sensor is held out"
    validated = (
        f"{_counted(validate)} used for validation"
        if validate
        else f"their samples in {fit_end:.6g} < t <= {time_end:.6g} are used for validation"
    )
    wanted = sum(
        value if isinstance(value, int) else len(value)
        for value in (splits.sensors.validate, splits.sensors.test)
    )
    fewer = len(validate) + len(test) < wanted
    asked = f"fewer are held out than the {wanted} of splits.sensors"
    why = f" With so few sensors, {asked}." if fewer else ""
    kept = "1 is a test sensor" if len(test) == 1 else f"{len(test)} are test sensors"
    return f"{sensors}, {validated}, {kept}; {held}.{why}"


def _counted(names: Sequence[str]) -> str:
    return f"{len(names)} {'is' if len(names) == 1 else 'are'}"
