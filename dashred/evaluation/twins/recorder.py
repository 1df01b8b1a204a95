"""Simulate a hidden truth at doubled resolution and observe it with noisy sensors.

All draws come from a random stream that the caller passes; the analysis never receives it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor

from dashred.config import Config
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensor_layout import place_sensors
from dashred.data.stated.known_readings import check_reads_state
from dashred.evaluation.twins.faulty_sensors import autocorrelated_noise, displaced, faulty_readings
from dashred.inference.initial_state.start_models import ScaledStart
from dashred.inference.results.corrected_system import with_parameters
from dashred.physics.expressions.algebra import Expr, multiply
from dashred.physics.runs.initial_state_prior import (
    StartPrior,
    field_rms,
    nominal_start,
    spread_in_percent,
)
from dashred.physics.solvers.simulate import Progress, check_finite, simulate
from dashred.physics.system import System, Term
from dashred.physics.window import box, gate, onset

if TYPE_CHECKING:
    from dashred.evaluation.twins.sealing import SealedTerm
    from dashred.evaluation.twins.twin_file import Twin

# Duration of the truth over that of the recording; the rest is for forecasts.
DURATION_FACTOR = 1.5


def simulate_truth(
    system: System,
    twin: Twin,
    config: Config,
    times: Tensor,
    rng: np.random.Generator,
    progress: Progress | None,
) -> Tensor:
    """Return the true states ``(time, field, *grid)`` on the simulator's grid."""
    lawful = true_system(system, twin)
    start = draw_start(system, lawful if twin.own_start else system, twin, config, rng)
    return run_truth(lawful, start, times, progress)


def true_system(system: System, twin: Twin) -> System:
    """Return the simulator with the true parameters and terms."""
    law = [(Term(t.equation, true_expression(system, t)), t.coefficient) for t in twin.terms]
    return with_parameters(system, twin.concealed.parameters).with_terms(law)


def draw_start(
    system: System, spun_up: System, twin: Twin, config: Config, rng: np.random.Generator
) -> Tensor:
    """Draw a start from the prior, on the doubled grid, ``(1, field, *grid)``.

    Args:
        system: the simulator; its nominal run gives the rms of the fields.
        spun_up: the system whose spun-up state is the mean of the prior.
        twin: the twin; it may scale the spread of the prior.
        config: configuration with the clock of the recording.
        rng: random stream of the twin.
    """
    every, duration = config.recording.every, config.recording.duration
    assert every is not None
    centre = nominal_start(spun_up)
    rms = torch.ones(len(system.fields), dtype=torch.float64)
    if spread_in_percent(system):
        times = torch.arange(round(duration / every) + 1, dtype=torch.float64) * every
        rms = field_rms(simulate(system, centre, times)[0])
    fine = spun_up.refined()
    fine_centre = system.grid.interpolate(centre, fine.grid) if system.axes else centre
    prior = StartPrior(fine, fine_centre[0], rms, None)
    return ScaledStart(prior, twin.concealed.spread).draw(1, rng)


def run_truth(
    lawful: System, start: Tensor, times: Tensor, progress: Progress | None = None
) -> Tensor:
    """Run the truth at doubled resolution; return it on the simulator's grid.

    Args:
        lawful: the true system.
        start: initial state on the doubled grid, ``(1, field, *grid)``.
        times: ``(time,)``.
        progress: callback that receives the completed share.

    Returns:
        ``(time, field, *grid)``.

    Raises:
        InputError: the truth blows up.
    """
    truth = lawful.refined()
    path = simulate(truth, start, times, progress=progress)
    check_finite(path, times, truth)
    return coarsen(path[0]).contiguous()


def coarsen(states: Tensor) -> Tensor:
    """Return every second grid point of states ``(any, field, *grid)``."""
    for dim in range(2, states.dim()):
        states = states[(slice(None),) * dim + (slice(None, None, 2),)]
    return states


def true_expression(system: System, term: SealedTerm) -> Expr:
    """Return the expression of a true term, multiplied by its window."""
    expression = system.parse(term.term, "recording.twin", equation=term.equation)
    if term.window is None:
        return expression
    of, begin, end, edge = term.window
    axes = {axis.name: axis for axis in system.axes}
    width = math.log(edge)
    if of in axes:
        assert begin is not None and end is not None
        window = box(axes[of]).at(((begin + end) / 2, (end - begin) / 2, width))
    elif of == "t":
        assert begin is not None
        window = onset().at((begin, width))
    elif begin is not None:
        window = gate(of, 1).at((begin, width))
    else:
        assert end is not None
        window = gate(of, -1).at((end, width))
    return multiply((window.expression, expression))


def observe(
    system: System,
    states: Tensor,
    times: Tensor,
    twin: Twin,
    config: Config,
    rng: np.random.Generator,
) -> Recording:
    """Observe the truth at random positions, with noise relative to the std of each quantity."""
    places, hidden = place_sensors(system, config, rng), twin.concealed
    check_reads_state(system, places)
    true_sensors = [displaced(sensor, hidden.faults, system) for sensor in places]
    clean = ObservationOperator(true_sensors, system)(states).numpy()
    noisy, sensors = np.empty_like(clean), []
    for column, sensor in enumerate(places):
        quantity = system.evaluate(sensor.reads, states)
        std = config.recording.noise * float(quantity.std())
        noise = std * autocorrelated_noise(rng.standard_normal(len(times)), hidden.correlation)
        read = clean[:, column] + noise
        noisy[:, column] = faulty_readings(read, times.numpy(), sensor, hidden.faults)
        stated = std * twin.stated if std > 0 else None
        sensors.append(type(sensor)(sensor.name, sensor.reads, sensor.position, stated))
    return Recording(tuple(sensors), times.numpy(), noisy)


def truth_times(config: Config) -> Tensor:
    """Return the times of the recording and of the forecast after it, ``(time,)``."""
    every = config.recording.every
    assert every is not None
    samples = round(DURATION_FACTOR * config.recording.duration / every)
    return torch.arange(samples + 1, dtype=torch.float64) * every
