"""Positive control: latent SINDy with the true field.

No analysis has that field; it comes from the recorder's functions, in this file alone. The truth
runs at doubled resolution, so the simulator's numerical error is in the answer as it would be in
reality. The encoder is untrained: the regression must not need a good one.
"""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.data.observation_operator import ObservationOperator
from dashred.evaluation.twins.recorder import observe, simulate_truth, truth_times
from dashred.evaluation.twins.twin_file import read_twin
from dashred.inference.latent_sindy.latent_sindy import LatentProblem, LatentSindy
from dashred.models.assimilation import AssimilatedEncoder, LatentTransform
from dashred.models.lag_windows import windows
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.terms.library import build_library

LATENT = 64


@pytest.mark.slow
@pytest.mark.positive_control
@pytest.mark.parametrize(("twin", "tolerance"), [("b", 0.02), ("c", 0.02)])
def test_algorithm_1_finds_the_law_of_the_rde_in_the_true_field(twin, tolerance):
    words = ["conf=rde", f"recording.twin={twin}", "recording.duration=6", "system.spin_up=30"]
    config = load_config(words, entry="record")
    hidden = read_twin(config)
    system, rng = System(config.system, config.where), np.random.default_rng(0)
    with torch.no_grad():
        times = truth_times(config)
        states = simulate_truth(system, hidden, config, times, rng, None)
        count = int((times <= config.recording.duration * (1 + 1e-9)).sum())
        times, states = times[:count], states[:count]
        sensors = observe(system, states, times, hidden, config, rng).sensors
        nominal = simulate(system, nominal_start(system), times)[0]
    operator = ObservationOperator(sensors[:10], system)
    library = build_library(system, config.library)
    problem = LatentProblem(
        system,
        library,
        term_scales(system, library, nominal, 0.0),
        operator,
        times,
        windows(operator(states), config.shred.lags),
        config.latent_sindy,
        0,
    )
    found = LatentSindy(problem, states, 12).propose(untrained(nominal, operator), states, 10)
    fit = found["alg1"]
    proposed = {
        (term.equation, str(term)): float(value)
        for term, value in zip(library, fit.coefficients, strict=True)
        if value
    }
    assert proposed == {
        (term.equation, term.term): pytest.approx(term.coefficient, rel=tolerance)
        for term in hidden.terms
    }


def untrained(nominal: torch.Tensor, operator: ObservationOperator) -> AssimilatedEncoder:
    torch.manual_seed(0)
    pod = POD.fit(nominal, 8)
    spread = torch.ones(len(pod.modes), dtype=torch.float64)
    shred = SHRED(Scaler.fit(operator(nominal)), pod, spread, LATENT, 1, [8]).double()
    return AssimilatedEncoder(shred, LatentTransform(LATENT, 8).double())
