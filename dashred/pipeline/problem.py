"""The problem of an analysis: simulator, library, recording and held-out data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.core.budget import Budget, Deadline
from dashred.core.files.scratch import Scratch
from dashred.core.findings.cause_schema import FaultySensor
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.splits import Split
from dashred.data.stated.fitted_delays import about_delays
from dashred.data.stated.known_factor import noise_factors
from dashred.data.stated.known_readings import known_readings, with_known_at
from dashred.data.stated.relative_noise import Array, relative_noise
from dashred.inference.fit.law import SensorFault
from dashred.inference.forward.candidates import ChangePrior
from dashred.inference.results.corrected_system import with_parameters
from dashred.inference.results.verdict import describe_fault
from dashred.physics.black_box.snapshots import Snapshots
from dashred.physics.hidden_state import HiddenState, with_hidden_states
from dashred.physics.parameter_sensitivity import parameters_read
from dashred.physics.system import System, Term
from dashred.physics.terms.let_terms import build_let_terms
from dashred.physics.terms.library import build_library
from dashred.pipeline.time_shares import LAST_OF_SEARCH, SHARE_OF_REST, ends_of

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
        scratch: folder for an ensemble that does not fit into memory.
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
    scratch: Scratch
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

        A stage begins when it asks. One that is not part of an analysis may take the whole time.
        """
        ends = ends_of(self.system, self.times, self.budget)
        end = self.budget.deadline(ends.get(stage, 1.0))
        if stage not in SHARE_OF_REST:
            return end
        rest = self.budget.deadline(ends[LAST_OF_SEARCH])
        return min(end, rest.part(SHARE_OF_REST[stage]), key=lambda each: each.at)

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
            clock = with_clause(episode.clock, reason)
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


def with_clause(sentence: str, clause: str) -> str:
    """Return a sentence with one clause more."""
    return f"{sentence.rstrip('.')}; {clause}."
