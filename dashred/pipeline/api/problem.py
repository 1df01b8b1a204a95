"""The problem: a simulator and a recording of the system that it simulates."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import torch

from dashred.config.checks.placeholders import refuse_unfinished_lines
from dashred.core.errors import InputError
from dashred.core.notebook_progress import display_here
from dashred.core.progress import shown_on
from dashred.data.inputs import drive_signals, with_inputs
from dashred.data.io.in_memory import HINT, RECORDING, SENSORS
from dashred.data.io.write_netcdf import recording_dataset
from dashred.physics.backends.input_signals import NO_INPUTS
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.system import System
from dashred.pipeline.api.check import Check
from dashred.pipeline.api.definition import NAME, Definition, from_file, from_values
from dashred.pipeline.api.recordings import read_recording, recording_overrides
from dashred.pipeline.api.session import session
from dashred.pipeline.api.simulator import TIMES, Simulator, as_times
from dashred.pipeline.check import command
from dashred.pipeline.check.page import Page
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.input.time_step import states_time_step

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from numpy.typing import ArrayLike

    from dashred.pipeline.api.result import Result

    Recorded: TypeAlias = xr.Dataset | pd.DataFrame | str | os.PathLike[str] | None
    Sensors: TypeAlias = pd.DataFrame | str | os.PathLike[str] | None

PLACES = {"recording.path": RECORDING, "recording.sensors": SENSORS}


class Problem:
    """A simulator and a recording of the system that it simulates.

    Create one with :meth:`from_yaml` or :meth:`from_dict`, which read, check and copy the
    recording.

    Attributes:
        config: the checked configuration.
    """

    def __init__(self, definition: Definition, recording: Any, sensors: Any) -> None:
        """Check the configuration and read the recording; use the class methods instead."""
        self._definition = definition
        self.config = definition.config()
        self._system = System(self.config.system, self.config.where)
        self._recorded = read_recording(recording, sensors, self.config, self._system)

    @classmethod
    def from_yaml(
        cls,
        system: str | os.PathLike[str],
        *,
        recording: Recorded = None,
        sensors: Sensors = None,
        overrides: Mapping[str, Any] | None = None,
        trust: str | None = None,
    ) -> Problem:
        """Create a problem from a YAML configuration.

        Args:
            system: name of a bundled system, such as ``"rde"``, or path of a YAML file.
            recording: sensor readings. Either an ``xarray.Dataset`` with ``value`` over
                ``(time, sensor)``, and ``name``, ``reads``, ``std`` and the coordinates of the axes
                over ``sensor``; or a ``pandas.DataFrame`` with ``time`` as a column or as the index
                and one column for each sensor; or the path of such a file (.nc, .csv). None uses
                the recording that the configuration names, if any.
            sensors: sensor table for a DataFrame or a CSV recording: a DataFrame or the path of a
                CSV with the columns ``name``, ``field``, one for each axis, and ``std`` if the
                noise is known. A system without axes needs no table if its columns have the names
                of the fields.
            overrides: values that override the configuration, by dotted keys, such as
                ``{"shred.lags": 30}``.
            trust: name of the class, function, FMU or command whose code may run.

        Raises:
            InputError: the configuration, an override or the recording is invalid.
        """
        given = {**(overrides or {}), **recording_overrides(recording, sensors)}
        places = {key: place for key, place in PLACES.items() if key in given}
        return cls(from_file(system, given, places, trust), recording, sensors)

    @classmethod
    def from_dict(
        cls,
        system: Mapping[str, Any],
        *,
        recording: Recorded = None,
        sensors: Sensors = None,
        overrides: Mapping[str, Any] | None = None,
        name: str = NAME,
        trust: str | None = None,
    ) -> Problem:
        """Create a problem from a dict with the content of a YAML configuration.

        Args:
            system: nested dicts, such as ``{"system": {"fields": {"u": "velocity"}, ...}}``.
            recording: as for :meth:`from_yaml`.
            sensors: as for :meth:`from_yaml`.
            overrides: as for :meth:`from_yaml`.
            name: name of the system.
            trust: as for :meth:`from_yaml`.

        Raises:
            InputError: the dict, an override or the recording is invalid.
        """
        given = {**(overrides or {}), **recording_overrides(recording, sensors)}
        places = {key: place for key, place in PLACES.items() if key in given}
        return cls(from_values(system, name, given, places, trust), recording, sensors)

    @property
    def recording(self) -> xr.Dataset | None:
        """The recording, with ``value`` over ``(time, sensor)``; None if there is none."""
        if self._recorded is None:
            return None
        episodes = self._recorded.episodes
        recorded = episodes[0].recording if len(episodes) == 1 else self._recorded
        return recording_dataset(recorded, [axis.name for axis in self._system.axes])

    def check(self) -> Check:
        """Check the problem within seconds, without a fit.

        Returns:
            The errors and warnings that ``dashred check`` prints.

        Raises:
            InputError: the input is invalid, so a run would refuse it.
        """
        page = Page(lambda line: None)
        with session(self.config):
            command.show_unfinished_lines(self.config, page)
            command.check(self.config, page, self._recorded)
        return Check.of(page)

    def simulate(
        self,
        start: xr.Dataset | Mapping[str, ArrayLike] | None = None,
        times: ArrayLike | None = None,
    ) -> xr.Dataset:
        """Run the simulator without any correction.

        Args:
            start: state at the first time: for each field a number or an array over the axes. None
                uses the start of the configuration, after its spin-up.
            times: output times ``(time,)``, increasing. None uses the times of the recording or,
                without a recording, those of ``recording.every`` and ``recording.duration``.

        Returns:
            The fields over ``(time, *axes)``.

        Raises:
            InputError: an argument is invalid, as in :meth:`Simulator.simulate`, or the simulator
                is given by snapshots only.
        """
        if self.config.system.snapshots is not None:
            what = "a simulator that is given by snapshots only cannot be run"
            raise InputError(what, where=self.config.where("system.snapshots"))
        with session(self.config):
            return self._simulator(times).simulate(start, times)

    def discover(self, seed: int | None = None, progress: bool = True) -> Result:
        """Find what the simulation leaves out.

        This runs the same stages as ``dashred train``, without MLflow and without files.

        Args:
            seed: seed of all random numbers; None uses the seed of the configuration.
            progress: whether to show a progress bar, in a notebook or on a terminal.

        Returns:
            The verdict, the law, the fields by method, and the corrected simulator.

        Raises:
            InputError: there is no recording, or the input is invalid.
        """
        from dashred.pipeline.api.discover import discover

        if self._recorded is None:
            hint = f"{HINT}; dashred.record makes one from a twin"
            raise InputError(
                "there is nothing to analyse: no recording", where=RECORDING, hint=hint
            )
        config = self._definition.config(seed)
        refuse_unfinished_lines(config)
        with session(config), shown_on(display_here(progress)):
            return discover(config, self._recorded)

    def __repr__(self) -> str:
        """The title of the system and the size of the recording."""
        title = self.config.system.title or self.config.name
        if self._recorded is None:
            return f"<dashred.Problem {title}: no recording>"
        sensors, episodes = self._recorded.sensors, self._recorded.episodes
        samples = sum(len(episode.recording.times) for episode in episodes)
        return f"<dashred.Problem {title}: {samples} samples of {len(sensors)} sensors>"

    def _simulator(self, times: ArrayLike | None) -> Simulator:
        """Return the simulator with the inputs of the recording, or of its first episode."""
        if self._recorded is not None:
            first = self._recorded.episodes[0].recording
            clock, inputs = torch.from_numpy(first.times), first.inputs
        else:
            clock = self._default_times(times)
            inputs = (
                drive_signals(self._system, self.config, clock)
                if self._system.inputs
                else NO_INPUTS
            )
        system = with_inputs(self._stepped_system(), inputs)
        return Simulator(system, lambda: nominal_start(system)[0], clock)

    def _stepped_system(self) -> System:
        """Return the simulator with its time step, which may be chosen from the recording."""
        if states_time_step(self._system):
            return self._system
        if self._recorded is None:
            what = "there is no time step, and no recording to choose it from"
            hint = "give system.integrator.dt"
            raise InputError(what, where=self.config.where("system.integrator"), hint=hint)
        return self._system.with_step(build_problem(self.config, self._recorded).system.dt)

    def _default_times(self, times: ArrayLike | None) -> torch.Tensor:
        """Return the times to use without a recording; they cover the given times."""
        every, duration = self.config.recording.every, self.config.recording.duration
        if times is not None:
            return torch.linspace(0.0, float(as_times(times)[-1]), 1001, dtype=torch.float64)
        if every is None:
            what = "there is no recording, and no step between samples"
            raise InputError(what, where=TIMES, hint="give the output times with times=")
        return torch.arange(round(duration / every) + 1, dtype=torch.float64) * every
