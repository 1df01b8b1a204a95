"""The problem of an analysis: simulator, library, recording and held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.config.checks.checks import MAX_STEPS
from dashred.core.budget import Budget, Deadline
from dashred.core.errors import InputError
from dashred.core.findings.cause_schema import FaultySensor
from dashred.core.stated.record_part import parse_part
from dashred.data.clocks.own_times import describe_times, has_uneven_times
from dashred.data.clocks.resampling import native_step, resample_all
from dashred.data.episodes import Episodes, name_episode_in_errors
from dashred.data.inputs import with_inputs
from dashred.data.noise_level import noise_std
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.splits import Split, hold_out_episode, split_recording
from dashred.data.stated.fitted_delays import about_delays
from dashred.data.stated.known_factor import noise_factors, with_even_noise
from dashred.data.stated.known_readings import known_readings, with_known_at
from dashred.data.stated.relative_noise import Array, relative_noise
from dashred.inference.fit.law import SensorFault
from dashred.inference.forward.candidates import ChangePrior
from dashred.inference.results.corrected_system import with_parameters
from dashred.inference.results.verdict import describe_fault
from dashred.physics.black_box.snapshot_file import open_snapshots
from dashred.physics.black_box.snapshots import Snapshots
from dashred.physics.hidden_state import HiddenState, with_hidden_states
from dashred.physics.let_terms import build_let_terms
from dashred.physics.library import build_library
from dashred.physics.parameter_sensitivity import parameters_read
from dashred.physics.system import System, Term
from dashred.pipeline.read_recorded import read_recorded
from dashred.pipeline.readings_of_state import fitted_count, readings_of_state
from dashred.pipeline.time_shares import begin_budget, ends_of
from dashred.pipeline.time_step import states_time_step, with_time_step

# Lower bound of the noise σ, as a share of the std of a trace, before the residuals give an
# estimate. With less noise than this the search would stop at laws that fit the recording only
# approximately.
MIN_NOISE_SHARE = 0.01


@dataclass(frozen=True)
class Problem:
    """The input of all later stages for one episode, with the other episodes.

    Attributes:
        config: settings of the analysis.
        system: simulator, driven by the inputs of this episode.
        library: candidate terms.
        recording_sha256: hash of the recording as it was read.
        times: times of the samples over the whole episode, ``(time,)``.
        clock: one sentence on how these times were chosen.
        split: roles of the sensors, and the parts of the recording.
        noise: standard deviation σ of the noise by sensor, in the unit of the sensor, as stated or
            estimated. It covers the fit and validation sensors and uses no held-out data.
        name: name of the episode.
        extensions: terms of the library that were added to it, because without them it could not
            explain the recording.
        left_out: default terms that the data cannot identify, with the reason: the term to which
            each is proportional, or a word. Empty until the simulation has run.
        others: the other fitted episodes; this one is the longest.
        whole: the episode that is held out as a whole, if any.
        snapshots: snapshots of a simulator without known equations; None if equations are given.
        budget: time of the run.
        longer_dt: time step of the ensemble and of derivatives if the configuration states none;
            None keeps that of the simulator.
        hidden: a hidden state that was added to the system, because without it no law could
            explain the recording.
        stated: values of the uncertain parameters as they are stated.
        sensed_at: values of parameters that sensors depend on, where these are not those of the
            system.
        described: the sensor, input or episode of uncertain parameters that belong to one.
    """

    config: Config
    system: System
    library: list[Term]
    recording_sha256: str
    times: Tensor
    clock: str
    split: Split
    noise: dict[str, float]
    name: str = ""
    extensions: tuple[Term, ...] = ()
    left_out: Mapping[Term, str | Term] = field(default_factory=dict)
    others: tuple[Problem, ...] = ()
    whole: tuple[Problem, ...] = ()
    snapshots: Snapshots | None = None
    budget: Budget = field(default_factory=Budget)
    longer_dt: float | None = None
    hidden: HiddenState | None = None
    stated: Mapping[str, float] = field(default_factory=dict)
    sensed_at: Mapping[str, float] = field(default_factory=dict)
    described: Mapping[str, Mapping[str, str]] = field(default_factory=dict)

    def deadline(self, stage: str) -> Deadline:
        """Return the time at which a stage ends (:mod:`.time_shares`).

        A stage that is not part of an analysis may take the whole time.
        """
        ends = ends_of(self.system, self.times, self.budget)
        return self.budget.deadline(ends.get(stage, 1.0))

    def without_budget(self) -> Problem:
        """Return the problem with as much time as its analysis takes."""
        return self._in_every_episode(lambda episode: replace(episode, budget=Budget()))

    def _in_every_episode(self, change: Callable[[Problem], Problem]) -> Problem:
        others, whole = (tuple(map(change, each)) for each in (self.others, self.whole))
        return replace(change(self), others=others, whole=whole)

    @property
    def episodes(self) -> tuple[Problem, ...]:
        """All fitted episodes."""
        return (self, *self.others)

    @property
    def ensemble_system(self) -> System:
        """The simulator with the time step of the ensemble."""
        dt = self.config.simulation.dt or self.longer_dt
        return self.system if dt is None else self.system.with_step(dt)

    def with_step(self, dt: float, reason: str) -> Problem:
        """Return the problem with another time step of the simulator, in every episode.

        Args:
            dt: the step.
            reason: one clause for the description of the clock.
        """

        def changed(episode: Problem) -> Problem:
            clock = _with_clause(episode.clock, reason)
            return replace(episode, system=episode.system.with_step(dt), clock=clock)

        return self._in_every_episode(changed)

    @property
    def let_terms(self) -> list[Term]:
        """Candidate terms of lets; their ``equation`` is the let."""
        return build_let_terms(self.system, self.config.library)

    @property
    def parameter_priors(self) -> dict[str, ChangePrior]:
        """Priors of the changes of the uncertain parameters, by name."""
        known = self.system.config
        values = {**known.parameters, **self.stated}
        return {
            name: ChangePrior(values[name] - known.parameters[name], spread)
            for name, spread in known.parameter_spread.items()
        }

    @property
    def stated_system(self) -> System:
        """The simulator with the stated values of the uncertain parameters."""
        return with_parameters(self.system, self.stated) if self.stated else self.system

    def with_parameters(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with other values of some parameters, in every episode."""

        def changed(episode: Problem) -> Problem:
            moved = with_parameters(episode.system, values)
            system = about_delays(moved, self.delayed, episode.split.fit.inputs)
            split = episode.split.each(lambda part: with_known_at(part, episode.sensed, system))
            return replace(episode, system=system, split=split, sensed_at={})

        return self._in_every_episode(changed)

    @property
    def delayed(self) -> dict[str, str]:
        """Name of the input whose delay is fitted, by parameter."""
        return {name: own["input"] for name, own in self.described.items() if "input" in own}

    def with_readings_at(self, values: Mapping[str, float]) -> Problem:
        """Return the problem with sensors that have other values of some parameters.

        The equations keep theirs. Without a sensor that depends on them, nothing changes.
        """
        read = parameters_read(self.system, self.quantities)
        moved = {name: value for name, value in values.items() if name in read}
        if not moved:
            return self

        def changed(episode: Problem) -> Problem:
            sensed = with_parameters(episode.sensed, moved)
            split = episode.split.each(lambda part: with_known_at(part, episode.sensed, sensed))
            return replace(episode, sensed_at={**episode.sensed_at, **moved}, split=split)

        return self._in_every_episode(changed)

    @property
    def quantities(self) -> list[tuple[str, ...]]:
        """What the sensors read, see :attr:`Sensor.quantities`, without repetitions."""
        parts = self.split.fit, self.split.validation, self.split.tested
        return [*{sensor.quantities: None for part in parts for sensor in part.sensors}]

    @property
    def sensed(self) -> System:
        """The system whose state the sensors read."""
        return with_parameters(self.system, self.sensed_at) if self.sensed_at else self.system

    def with_longer_step(self, dt: float) -> Problem:
        """Return the problem with another time step of the ensemble, in every episode."""
        return self._in_every_episode(lambda episode: replace(episode, longer_dt=dt))

    def with_library(self, library: list[Term]) -> Problem:
        """Return the problem with other candidate terms, in every episode."""
        return self._in_every_episode(lambda episode: replace(episode, library=library))

    def with_extensions(self, terms: Sequence[Term]) -> Problem:
        """Return the problem with terms that its library does not contain."""
        return replace(self.with_library([*self.library, *terms]), extensions=tuple(terms))

    def with_hidden_state(self, state: HiddenState, equation: str, term: str) -> Problem:
        """Return the problem with a hidden state in the system, and a term with it.

        Args:
            state: the hidden state.
            equation: the equation in which it acts.
            term: what its gain multiplies, in this equation.
        """

        def changed(episode: Problem) -> Problem:
            system = episode.system
            config = with_hidden_states(system.config, [state])
            return replace(episode, system=system.with_config(config), hidden=state)

        augmented = self._in_every_episode(changed)
        return augmented.with_extensions(build_library(augmented.system, {equation: [term]}))

    def operator(self, recording: Recording) -> ObservationOperator:
        """Return the observation operator H of the sensors of a part of the recording."""
        return ObservationOperator(recording.sensors, self.sensed)

    def noise_of(self, names: tuple[str, ...]) -> Tensor:
        """Return the noise σ of the named sensors, ``(sensor,)``."""
        return torch.tensor([self.noise[name] for name in names], dtype=torch.float64)

    def relative_noise(self, recording: Recording) -> Array | None:
        """Return σ of every reading as a factor of its sensor's; see :func:`relative_noise`.

        Args:
            recording: a part of the recording of this episode.
        """
        known = known_readings(recording, self.sensed)
        return relative_noise(recording, known, noise_factors(recording, self.sensed))

    def fit_noise_std(self) -> Tensor:
        """Return the noise σ of the fit sensors before any fit, ``(sensor,)``.

        A sensor has the same noise in all episodes.
        """
        names = self.split.fit.names
        traces = [torch.from_numpy(e.split.fit.trace_std()) for e in self.episodes]
        largest = torch.stack(traces).amax(dim=0)
        return torch.maximum(self.noise_of(names), MIN_NOISE_SHARE * largest)

    def fault_details(self, fault: SensorFault) -> FaultySensor:
        """Return a sensor fault as data, with the field that the sensor reads."""
        split, axes = self.split, self.system.axes
        parts = (split.fit, split.validation, split.tested)
        reads = {s.name: s.reads for part in parts for s in part.sensors}
        episode = None if fault.episode is None else self.episodes[fault.episode].name
        described = describe_fault(fault)
        if len(self.episodes) > 1:
            for curve, own in zip(described["curve"] or [], self.episodes, strict=False):
                curve["episode"] = own.name
        return {
            **described,
            "reads": reads.get(fault.sensor),
            "axis": axes[0].name if len(axes) == 1 else None,
            "episode": episode,
        }

    def rng(self, stage: str) -> np.random.Generator:
        """Return the random number generator of one stage, independent of all other stages."""
        return np.random.default_rng([self.config.seed, *stage.encode()])


def build_problem(config: Config, recorded: Episodes | None = None) -> Problem:
    """Read and check all input.

    Args:
        config: settings of the analysis.
        recorded: recording; None reads the file at ``recording.path``.

    Raises:
        InputError: the equations, the snapshots, the library, the recording or the split is
            invalid.
    """
    budget = begin_budget(config)
    system = System(config.system, config.where)
    library = build_library(system, config.library)
    read = read_recorded(config, system) if recorded is None else recorded
    sha256 = read.sha256()
    system, read, subtracted, described = readings_of_state(config, system, read)
    # The system and the recording may each state units. The reader has converted the values.
    units = {**read.episodes[0].recording.units, **system.units}
    system = system.with_config(replace(system.config, units=units))
    every, snapshots = config.recording.every, _snapshots(system, read)
    if snapshots is not None:
        every = snapshots.clock_step(native_step(read.episodes[0].recording.times), every)
    # The integrators of fields need uniform steps, and SHRED of snapshots too.
    if every is None and not system.axes and snapshots is None and has_uneven_times(read):
        sampled, clock = read, describe_times(read)
    else:
        sampled, clock = resample_all(read, every)
    for clause in subtracted:
        clock = _with_clause(clock, clause)
    chosen_part = parse_part(config.recording.begin, config.recording.end, config.where)
    if not chosen_part.is_whole:
        clock = _with_clause(clock, f"the part {chosen_part} of the recording")
    if read.left_out:
        clock = _with_clause(clock, f"without the columns {', '.join(read.left_out)}")
    splits = []
    for part in sampled.episodes:
        with name_episode_in_errors(part.name):
            times = part.recording.times
            _check_steps(config, float(times[-1] - times[0]), system.dt)
            splits.append(split_recording(part.recording, config.splits, config.seed))
    raw = [episode.recording for episode in read.episodes]
    fitted = fitted_count(config, read)
    if fitted < len(splits):
        splits[-1] = hold_out_episode(sampled.episodes[-1].recording, splits[-1])
    even = [with_even_noise(part, with_inputs(system, part.inputs)) for part in raw[:fitted]]
    noise = _noise(even, splits[:fitted])
    if not states_time_step(system):
        longest_fit = max((split.fit for split in splits[:fitted]), key=lambda fit: len(fit.times))
        std = np.array([noise[name] for name in longest_fit.names])
        driven = with_inputs(system, longest_fit.inputs)
        limit = config.resolution_limit
        chosen, why = with_time_step(driven, longest_fit, std, limit, budget)
        system = system.with_fixed_steps().with_step(chosen.dt)
        clock = _with_clause(clock, why)
    stated = {name: system.config.parameters[name] for name in system.config.parameter_spread}
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
            name=episode.name,
            snapshots=snapshots,
            budget=budget,
            stated=stated,
            described=described,
        )
        for episode, split in zip(sampled.episodes, splits, strict=True)
    ]
    longest = max(problems[:fitted], key=lambda problem: len(problem.split.fit.times))
    others = tuple(problem for problem in problems[:fitted] if problem is not longest)
    return replace(longest, others=others, whole=tuple(problems[fitted:]))


def _with_clause(sentence: str, clause: str) -> str:
    """Return a sentence with one clause more."""
    return f"{sentence.rstrip('.')}; {clause}."


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
        hint = f"the limit is {MAX_STEPS} steps: is the unit of time the same in both?"
        raise InputError(what, where=config.where("system.integrator.dt"), hint=hint)


def _noise(raw: Sequence[Recording], splits: Sequence[Split]) -> dict[str, float]:
    """Return the noise σ of every fit and validation sensor, from the fit window."""
    early = []
    for recording, split in zip(raw, splits, strict=True):
        seen = recording.select([name for name in recording.names if name not in split.test])
        early.append(seen.between(float(recording.times[0]), split.time_end))
    return dict(zip(early[0].names, noise_std(*early).tolist(), strict=True))
