"""Read and check all input of an analysis, and build its problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from dashred.config import Config
from dashred.config.checks.checks import MAX_STEPS
from dashred.core.errors import InputError
from dashred.core.stated.record_part import parse_part
from dashred.data.clocks.own_times import describe_times, has_uneven_times
from dashred.data.clocks.resampling import native_step, resample_all
from dashred.data.episodes import Episodes, name_episode_in_errors
from dashred.data.inputs import with_inputs
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.splits import Split, check_read, hold_out_episode, split_recording
from dashred.data.stated.known_factor import with_even_noise
from dashred.physics.black_box.snapshot_file import open_snapshots
from dashred.physics.black_box.snapshots import Snapshots
from dashred.physics.runs.initial_state_prior import stated_start
from dashred.physics.system import System
from dashred.physics.terms.library import build_library
from dashred.pipeline.input.dynamics_check import check_dynamics
from dashred.pipeline.input.read_recorded import read_recorded
from dashred.pipeline.input.readings_of_state import fitted_count, readings_of_state
from dashred.pipeline.input.scratch_folder import scratch_of
from dashred.pipeline.input.time_step import states_time_step, with_time_step
from dashred.pipeline.problem import Problem, with_clause
from dashred.pipeline.time_shares import begin_budget

# Columns that are listed by name.
MOST_LISTED = 16


def build_problem(config: Config, recorded: Episodes | None = None) -> Problem:
    """Read and check all input.

    Args:
        config: settings of the analysis.
        recorded: recording; None reads the file at ``recording.path``.

    Raises:
        InputError: the equations, the snapshots, the library, the recording or the split is
            invalid, or the simulator cannot be stepped inside of the assimilation.
    """
    budget = begin_budget(config)
    system = System(config.system, config.where, device=torch.device(config.device))
    if system.program is not None:
        system.program.forget_failures()
    declared = system
    read = read_recorded(config, system) if recorded is None else recorded
    sha256 = read.sha256()
    system, read, subtracted, described = readings_of_state(config, system, read)
    # The system and the recording may each state units. The reader has converted the values.
    units = {**read.episodes[0].recording.units, **system.units}
    system = system.with_config(replace(system.config, units=units))
    # The unit of a column tells which fields are angles.
    library = build_library(
        declared.with_config(replace(declared.config, units=units)), config.library
    )
    every, snapshots = config.recording.every, _snapshots(system, read)
    if snapshots is not None:
        every = snapshots.clock_step(native_step(read.episodes[0].recording.times), every)
    # The integrators of fields need uniform steps, and SHRED of snapshots too.
    if every is None and not system.axes and snapshots is None and has_uneven_times(read):
        sampled, clock = read, describe_times(read)
    else:
        sampled, clock = resample_all(read, every)
    for clause in subtracted:
        clock = with_clause(clock, clause)
    chosen_part = parse_part(config.recording.begin, config.recording.end, config.where)
    if not chosen_part.is_whole:
        clock = with_clause(clock, f"the part {chosen_part} of the recording")
    if read.is_rounded:
        clock = with_clause(clock, "with an even step, because the file repeats rounded times")
    if read.left_out:
        clock = with_clause(clock, f"without the columns {_listed(read.left_out)}")
    splits = []
    for part in sampled.episodes:
        with name_episode_in_errors(part.name):
            times = part.recording.times
            _check_steps(config, float(times[-1] - times[0]), system.dt)
            splits.append(split_recording(part.recording, config.splits, config.seed))
    raw = [episode.recording for episode in read.episodes]
    fitted = fitted_count(config, read)
    check_read(splits[:fitted])
    if fitted < len(splits):
        splits[-1] = hold_out_episode(sampled.episodes[-1].recording, splits[-1])
    even = [with_even_noise(part, with_inputs(system, part.inputs)) for part in raw[:fitted]]
    noise = _noise(even, splits[:fitted])
    if not states_time_step(system):
        longest_fit = max((split.fit for split in splits[:fitted]), key=_size)
        std = np.array([noise[name] for name in longest_fit.names])
        driven = with_inputs(system, longest_fit.inputs)
        limit = config.resolution_limit
        chosen, why = with_time_step(driven, longest_fit, std, limit, budget)
        system = system.with_fixed_steps().with_step(chosen.dt)
        clock = with_clause(clock, why)
    stated = {name: system.config.parameters[name] for name in system.config.parameter_spread}
    scratch = scratch_of(config, sha256)
    problems = [
        Problem(
            config=config,
            system=with_inputs(system, episode.recording.inputs),
            library=library,
            recording_sha256=sha256,
            times=torch.from_numpy(episode.recording.times),
            clock=clock,
            split=split,
            noise=noise,
            scratch=scratch,
            name=episode.name,
            snapshots=snapshots,
            budget=budget,
            stated=stated,
            described=described,
        )
        for episode, split in zip(sampled.episodes, splits, strict=True)
    ]
    _check_starts(problems)
    check_dynamics(problems[0])
    longest = max(problems[:fitted], key=lambda problem: _size(problem.split.fit))
    others = tuple(problem for problem in problems[:fitted] if problem is not longest)
    return replace(longest, others=others, whole=tuple(problems[fitted:]))


def _size(fit: Recording) -> tuple[int, int]:
    """Return the number of samples of an episode, and that of the sensors it has values of."""
    return len(fit.times), int(fit.is_read().sum())


def _listed(names: Sequence[str]) -> str:
    """Return the first names, and the number of the others."""
    more = len(names) - MOST_LISTED
    return ", ".join(names[:MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


def _snapshots(system: System, read: Episodes) -> Snapshots | None:
    """Open the snapshots of the simulator; return None if it is given by equations.

    Raises:
        InputError: they do not fit the system, or the recording has several episodes.
    """
    path = system.config.snapshots
    if path is None:
        return None
    if len(read.episodes) > 1:
        what = (
            f"the recording has {len(read.episodes)} episodes, but an analysis with snapshots "
            "takes one"
        )
        raise InputError(what, hint="analyse one episode at a time")
    return open_snapshots(path, system)


def _check_steps(config: Config, span: float, dt: float) -> None:
    if span > MAX_STEPS * dt:
        what = f"the recording spans {span:g}, which takes too many steps of {dt:g}"
        hint = f"the limit is {MAX_STEPS} steps; are both in the same unit of time?"
        raise InputError(what, where=config.where("system.integrator.dt"), hint=hint)


def _check_starts(problems: Sequence[Problem]) -> None:
    """Check that the episodes have one stated start, within its spread.

    Raises:
        InputError: it reads an input whose first values differ.
    """
    first = problems[0].system
    if first.config.snapshots is not None or not first.inputs or len(problems) == 1:
        return
    starts = [stated_start(problem.system)[0] for problem in problems]
    for index, field in enumerate(first.fields):
        values = torch.stack([start[index] for start in starts])
        stated = first.config.spread.get(field, 0.0)
        spread = stated if isinstance(stated, int | float) else 0.0
        if not torch.allclose(values, values[:1], atol=spread):
            what = f"the start of {field} reads an input that differs between the episodes"
            hint = f"give all episodes one start with a spread, {field}: {{value: …, spread: …}}: "
            hint += "it is fitted separately in each episode"
            raise InputError(what, where=first.where(f"system.start.{field}"), hint=hint)


def _noise(raw: Sequence[Recording], splits: Sequence[Split]) -> dict[str, float]:
    """Return the noise σ of every fit and validation sensor, from the fit window."""
    early = []
    for recording, split in zip(raw, splits, strict=True):
        seen = recording.select([name for name in recording.names if name not in split.test])
        early.append(seen.between(float(recording.times[0]), split.time_end))
    return dict(zip(early[0].names, noise_std(*early).tolist(), strict=True))
