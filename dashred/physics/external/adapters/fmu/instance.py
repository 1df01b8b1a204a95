"""One instance of an FMU, with the same methods for FMI 2 and 3."""

from __future__ import annotations

import math
import os
import shutil
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property, partial
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.physics.external.adapters.fmu.description import MODEL_EXCHANGE, Description
from dashred.physics.external.state_batch import Array, ProgramError

# Events at one time after which an FMU counts as stuck.
MOST_EVENTS = 100
LAST_MESSAGES = 5


class NoDerivativesError(ProgramError):
    """An FMU returns an error for its directional derivatives."""


class Instance:
    """An FMU in this process.

    Attributes:
        next_event: time of the next event that the FMU has announced.
    """

    next_event = math.inf

    def __init__(self, description: Description) -> None:
        """Unpack and instantiate an FMU.

        Raises:
            ProgramError: it cannot be loaded or instantiated.
        """
        import fmpy
        from fmpy.simulation import instantiate_fmu

        self._own, self._messages = description, deque[str](maxlen=LAST_MESSAGES)
        # Removed when this object is, at the latest when the process ends.
        folder = mkdtemp(prefix="dashred-fmu-")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        before = os.getcwd()
        with self._last_words():
            try:
                fmpy.extract(description.path, folder)
                self._fmu = instantiate_fmu(
                    folder,
                    description.description,
                    description.kind,
                    logger=self._log(),
                )
            finally:
                os.chdir(before)  # FMPy stays in the folder of a library that cannot be loaded.
        size = len(description.order)
        self._buffer, self._slopes = np.zeros(size), np.zeros(size)
        self._events = np.zeros(self._event_indicators())
        self._pointers = _pointer(self._buffer), _pointer(self._slopes), _pointer(self._events)

    @property
    def has_events(self) -> bool:
        """Whether what it does may follow from more than its continuous states."""
        return self._events.size > 0 or self.next_event < math.inf

    def start(self, t: float, values: Sequence[tuple[Any, float]]) -> None:
        """Initialise the FMU at a time, with start values of variables.

        Raises:
            ProgramError: it refuses, or a value is not of a variable's type.
        """
        with self._last_words():
            self._fmu.reset()
            self._set(values, before=True)
            if self._own.is_second:
                self._fmu.setupExperiment(startTime=t)
                self._fmu.enterInitializationMode()
            else:
                self._fmu.enterInitializationMode(startTime=t)
            self._set(values, before=False)
            self._fmu.exitInitializationMode()
            if self._own.kind == MODEL_EXCHANGE:
                self._settle_events()

    def do_step(self, t: float, dt: float) -> None:
        """Step an FMU for co-simulation."""
        with self._last_words():
            self._fmu.doStep(t, dt)

    def read_fields(self) -> Array:
        """Return the values of the fields."""
        references = [variable.valueReference for variable in self._own.fields]
        with self._last_words():
            read = self._fmu.getReal if self._own.is_second else self._fmu.getFloat64
            return np.array(read(references), dtype=np.float64)

    def set_inputs(self, values: Mapping[Any, float]) -> None:
        """Set variables while an FMU for model exchange is integrated."""
        with self._last_words():
            for variable, value in values.items():
                self._set_one(variable, value)

    def slopes(self, t: float, x: Array) -> Array:
        """Return the derivatives of the continuous states x at a time."""
        with self._last_words():
            self._set_states(t, x)
            if self._own.is_second:
                self._fmu.getDerivatives(self._pointers[1], len(x))
            else:
                self._fmu.getContinuousStateDerivatives(self._pointers[1], len(x))
        return self._slopes.copy()

    def slopes_along(self, t: float, x: Array, directions: Array) -> tuple[Array, Array]:
        """Return :meth:`slopes`, and their derivatives along directions, ``(state, direction)``.

        Raises:
            NoDerivativesError: the FMU returns an error for the derivatives.
        """
        slopes, along = self.slopes(t, x), np.empty_like(directions)
        try:
            with self._last_words():
                for j in range(directions.shape[1]):
                    self._buffer[:] = directions[:, j]
                    self._derive()
                    along[:, j] = self._slopes
        except ProgramError as error:
            raise NoDerivativesError(str(error)) from error
        return slopes, along

    @cached_property
    def _derive(self) -> Callable[[], int]:
        """A call that derives the slopes along the buffer."""
        from ctypes import c_uint

        size, unknowns = len(self._buffer), self._own.description.derivatives
        many = c_uint * size
        rates = many(*(each.variable.valueReference for each in unknowns))
        states = many(*(each.variable.derivative.valueReference for each in unknowns))
        along, result, _ = self._pointers
        fmu = self._fmu
        given = fmu.component, rates, size, states, size, along
        if self._own.is_second:
            return partial(fmu.fmi2GetDirectionalDerivative, *given, result)
        return partial(fmu.fmi3GetDirectionalDerivative, *given, size, result, size)

    def signs(self, t: float, x: Array) -> NDArray[np.bool_]:
        """Return whether each event indicator is positive; an event is where one changes."""
        if self._events.size:
            with self._last_words():
                self._set_states(t, x)
                self._fmu.getEventIndicators(self._pointers[2], self._events.size)
        return self._events > 0

    def complete_step(self, t: float, x: Array, is_event: bool) -> Array:
        """Tell the FMU that the states x are reached; return those after an event, if any."""
        with self._last_words():
            self._set_states(t, x)
            wants_event, ends = self._fmu.completedIntegratorStep()
            if ends:
                raise ProgramError(f"ends its simulation at t = {t:g}")
            if not (wants_event or is_event or t >= self.next_event):
                return x
            self._fmu.enterEventMode()
            self._settle_events()
            self._fmu.getContinuousStates(self._pointers[0], len(x))
        return self._buffer.copy()

    def _set_states(self, t: float, x: Array) -> None:
        self._buffer[:] = x
        self._fmu.setTime(t)
        self._fmu.setContinuousStates(self._pointers[0], len(x))

    def _settle_events(self) -> None:
        update = (
            self._fmu.newDiscreteStates if self._own.is_second else self._fmu.updateDiscreteStates
        )
        for _ in range(MOST_EVENTS):
            again, ends, _, _, has_next, next_event = update()
            if ends:
                raise ProgramError("ends its simulation at an event")
            self.next_event = next_event if has_next else math.inf
            if not again:
                self._fmu.enterContinuousTimeMode()
                return
        raise ProgramError(f"has {MOST_EVENTS} events at one time, and does not settle")

    def _set(self, values: Sequence[tuple[Any, float]], before: bool) -> None:
        """Set start values that may be set before, or in, the initialisation."""
        for variable, value in values:
            approximate = variable.initial == "approx"
            if (approximate or variable.causality == "structuralParameter") == before:
                self._set_one(variable, value)

    def _set_one(self, variable: Any, value: float) -> None:
        kind = {"Real": "Real", "Enumeration": "Integer" if self._own.is_second else "Int64"}
        kind = kind.get(variable.type, variable.type)
        typed: float | int | bool = value
        if kind not in ("Real", "Float64", "Float32"):
            typed = bool(value) if kind == "Boolean" else int(value)
            if typed != value:
                raise ProgramError(f"takes no {value:g} for {variable.name}, a {variable.type}")
        getattr(self._fmu, f"set{kind}")([variable.valueReference], [typed])

    def _event_indicators(self) -> int:
        if self._own.kind != MODEL_EXCHANGE:
            return 0
        if self._own.is_second:
            return int(self._own.description.numberOfEventIndicators)
        return int(self._fmu.getNumberOfEventIndicators())

    def _log(self) -> Callable[..., None]:
        messages = self._messages

        # FMI 2: component, instance, status, category, message; FMI 3 has no instance.
        def log(*words: Any) -> None:
            messages.append(words[-1].decode("utf-8", "replace").strip())

        return log

    @contextmanager
    def _last_words(self) -> Iterator[None]:
        """Turn an error into one with the FMU's last messages."""
        try:
            yield
        except ProgramError:
            raise
        except Exception as error:  # FMPy raises plain exceptions
            said = "".join(f"\n    {message}" for message in self._messages)
            self._messages.clear()
            what = f"fails: {error}" + (f"; it said:{said}" if said else "")
            raise ProgramError(what) from error


def _pointer(values: Array) -> Any:
    import ctypes

    return values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
