"""Hidden terms in windows are found where they act; nothing is found if nothing is missing."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dashred.core.budget import Budget
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.law import Law
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.comparison.compare_hypotheses import compare_hypotheses
from dashred.inference.hypotheses.comparison.comparison import Additions, Comparison
from dashred.inference.hypotheses.extended.nonlinear_constants import parse_tunable_term
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import AMBIGUITY_MARGIN, MIN_FORCING_GAIN
from dashred.inference.hypotheses.sensors.excluded_sensors import (
    add_faults,
    add_faults_or_refit,
)
from dashred.physics.window import Shape, box, gate, onset
from tests.waves import TIMES, Waves, fitted

SIGMA = 0.02


def compare_with_term(
    waves: Waves, name: str | None, shape: Shape | None, edges: list[float], xi: float
) -> Comparison:
    """Return the comparison for a recording with a hidden term."""
    law = []
    if name is not None:
        candidate = waves.everything[name]
        law = [(restrict_to_window([candidate], shape.at(edges))[0] if shape else candidate, xi)]
    return compare(waves, waves.recorded(SIGMA, 1, law))


def compare(waves: Waves, recorded: Tensor) -> Comparison:
    """Return the comparison for a recording, without laws from an earlier search."""
    everything = waves.objective(recorded, SIGMA, list(waves.everything))
    null = waves.objective(recorded, SIGMA)
    found = minimise(null, fitted(null), 6, 1e-4)
    empty = HypothesisFit(build_law(null, found, found.cost), null, found.phi)
    additions = Additions(
        global_count=len(waves.everything),
        tendency_rms=waves.size,
        windowed_simulator=lambda: waves.simulator,
        extended_candidates=lambda: waves.extended,
    )
    return compare_hypotheses(everything, empty, empty, [], additions, Budget(), lambda *_: None)


def term(law: Law) -> str:
    [candidate] = law.candidates
    return candidate.key


def test_a_region_is_found(waves: Waves) -> None:
    shape = box(waves.system.axes[0])
    found = compare_with_term(waves, "u: u", shape, [6.0, 1.5, math.log(0.3)], -0.25)
    best = found.laws[0]
    assert term(best) == "u: u" and best.window is not None and best.window.shape == shape
    centre, half, _ = best.window.values
    xi, std = float(best.coefficients[0]), float(best.std[0])
    # Six sensors cannot distinguish a wide weak region from a narrow strong one. The standard
    # deviations show this.
    assert abs(centre - 6.0) < 0.1 and abs(half - 1.5) < 3 * best.edges[1] < 1.2
    assert abs(xi + 0.25) < 3 * std and xi * half == pytest.approx(-0.25 * 1.5, rel=0.15)
    assert found.forcing_gain < MIN_FORCING_GAIN and len(best.edges) == 3
    # The noise is estimated under the best law, not under a wrong one.
    assert float(found.noise.std[0]) == pytest.approx(SIGMA, rel=0.12)


@pytest.mark.slow
def test_an_onset_is_found(waves: Waves) -> None:
    found = compare_with_term(waves, "v: 1", onset(), [4.0, math.log(0.2)], 0.15)
    best = found.laws[0]
    assert term(best) == "v: 1" and best.window is not None
    assert best.window.shape.kind == "onset" and abs(best.window.values[0] - 4.0) < 0.3
    assert found.forcing_gain < MIN_FORCING_GAIN


@pytest.mark.slow
def test_a_gate_is_found_or_among_the_rivals(waves: Waves) -> None:
    found = compare_with_term(waves, "u: v**2", gate("u", 1), [0.2, math.log(0.1)], -0.4)
    near = [law for law in found.laws if law.score < found.laws[0].score + 10]
    assert any(
        term(law) == "u: v**2" and law.window is not None and law.window.shape == gate("u", 1)
        for law in near
        if len(law.candidates) == 1
    )


@pytest.mark.slow
def test_a_term_that_acts_everywhere_needs_no_window(waves: Waves) -> None:
    best = compare_with_term(waves, "u: u**2", None, [], -0.15).laws[0]
    assert term(best) == "u: u**2" and best.window is None
    assert abs(float(best.coefficients[0]) + 0.15) < 4 * float(best.std[0]) < 0.03


@pytest.mark.parametrize("seed", [1, 2])
def test_nothing_is_found_if_nothing_is_missing(waves: Waves, seed: int) -> None:
    recorded = waves.recorded(SIGMA, seed)
    null = waves.objective(recorded, SIGMA)
    phi = fitted(null)
    _, gain = fit_free_forcing(null, phi, waves.size)
    assert gain < MIN_FORCING_GAIN
    found = compare_with_term(waves, None, None, [], 0.0)
    assert not found.laws[0].parts and torch.isfinite(found.noise.std).all()
    assert len(TIMES) == len(recorded)


@pytest.mark.slow
def test_a_law_beyond_the_library_is_found(waves: Waves) -> None:
    known = {str(found): found for found in waves.extended}
    found = compare(waves, waves.recorded(SIGMA, 1, [(known["u: sin(2*u)"], 0.3)]))
    best = found.laws[0]
    [candidate] = best.candidates
    assert candidate.is_extended and candidate.key == "u: sin(2*u)"
    assert abs(float(best.coefficients[0]) - 0.3) < 3 * float(best.std[0]) < 0.1
    assert found.forcing_gain < MIN_FORCING_GAIN
    assert best.score < min(law.score for law in found.laws if not law.is_extended) - 6


@pytest.mark.slow
def test_the_constant_of_a_law_beyond_the_library_is_fitted(waves: Waves) -> None:
    known = {str(found): found for found in waves.extended}
    offered = parse_tunable_term(known["u: sin(2*u)"])
    assert offered is not None
    found = compare(waves, waves.recorded(SIGMA, 1, [(offered.at(2.4).candidate, 0.3)]))
    [candidate] = found.laws[0].candidates
    fitted = parse_tunable_term(candidate)
    assert fitted is not None and fitted.function == "sin" and candidate.is_extended
    assert fitted.constant == pytest.approx(2.4, abs=0.03)
    assert candidate.key == f"u: sin({fitted.constant:.4g}*u)"
    assert float(found.laws[0].coefficients[0]) == pytest.approx(0.3, rel=0.1)


@pytest.mark.slow
def test_a_wave_is_found_whatever_its_phase(waves: Waves) -> None:
    known = {str(found): found for found in waves.extended}
    names = [f"u: u*{wave}(0.6283185307179586*x)" for wave in ("sin", "cos")]
    law = [(known[name], xi) for name, xi in zip(names, (0.2, -0.2), strict=True)]
    found = compare(waves, waves.recorded(SIGMA, 1, law))
    best = found.laws[0]
    true = {candidate.key: xi for candidate, xi in law}
    assert {candidate.key for candidate in best.candidates} == true.keys()
    for candidate, xi, std in zip(best.candidates, best.coefficients, best.std, strict=True):
        assert abs(float(xi) - true[candidate.key]) < 3 * float(std) < 0.1
    assert found.forcing_gain < MIN_FORCING_GAIN


@pytest.mark.slow
def test_a_faulty_sensor_is_found_together_with_a_law(waves: Waves) -> None:
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u**2"], -0.15)])
    recorded[:, 2] += 0.4
    best = compare(waves, recorded).laws[0]
    assert term(best) == "u: u**2" and best.window is None
    assert abs(float(best.coefficients[0]) + 0.15) < 4 * float(best.std[0]) < 0.05
    [fault] = best.faults
    assert fault.std is not None
    assert (fault.kind, fault.sensor) == ("bias", "s2")
    assert abs(fault.value - 0.4) < 4 * fault.std < 0.1


@pytest.mark.slow
def test_rivals_are_compared_with_the_fault_too(waves: Waves) -> None:
    """Without this the law that wins with the fault would have no rivals."""
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u"], -0.25)])
    recorded[:, 2] += 0.2
    # There is no penalty for the further term here: the data cannot distinguish the two laws.
    best = fitted_law(waves, recorded, ["u: u"])
    rival = fitted_law(waves, recorded, ["u: u", "v: 1"])
    everything = waves.objective(recorded, SIGMA, list(waves.everything))
    additions = Additions(len(waves.everything), waves.size, lambda: waves.simulator, list)
    null = fitted_law(waves, recorded, [])
    found = compare_hypotheses(
        everything, best, null, [rival], additions, Budget(), lambda *_: None
    )
    first, second = found.laws[:2]
    assert all([each.sensor for each in law.faults] == ["s2"] for law in (first, second))
    assert second.score - first.score < AMBIGUITY_MARGIN
    keys = [{candidate.key for candidate in law.candidates} for law in (first, second)]
    assert {"u: u"} in keys and {"u: u", "v: 1"} in keys
    alone = compare_hypotheses(everything, best, null, [], additions, Budget(), lambda *_: None)
    assert not any("v: 1" in {c.key for c in law.candidates} for law in alone.laws)


def fitted_law(waves: Waves, recorded: Tensor, names: list[str]) -> HypothesisFit:
    """Return a law that acts everywhere, fitted."""
    objective = waves.objective(recorded, SIGMA, names)
    begin = torch.zeros(objective.modes + len(names), dtype=torch.float64)
    found = minimise(objective, begin, 20, 1e-6)
    return HypothesisFit(build_law(objective, found, found.cost), objective, found.phi)


@pytest.mark.parametrize("bias", [0.0, 0.4])
def test_a_fault_without_gain_is_rejected(waves: Waves, bias: float) -> None:
    """The gain is that of the linearised problem, because a fit to all samples may get stuck."""
    recorded = waves.recorded(SIGMA, 1)
    recorded[:, 2] += bias
    whole = waves.objective(recorded, SIGMA)
    seen = whole.noise.available.clone()
    seen[:, 2] = False
    objective = replace(whole, noise=replace(whole.noise, available=seen))
    found = minimise(objective, fitted(objective), 6, 1e-4)
    without_fault = HypothesisFit(build_law(objective, found, found.cost), objective, found.phi)
    excluded = add_faults(without_fault, (2,)).excluded
    assert excluded is not None and (excluded.gain > 0) == bool(bias)
    fits = add_faults_or_refit([without_fault], (2,))
    assert all(bool(fit.law.faults) == bool(bias) for fit in fits[:1])


@pytest.mark.slow
def test_a_law_of_the_library_is_not_replaced_by_an_extended_one(waves: Waves) -> None:
    found = compare_with_term(waves, "u: u**2", None, [], 0.1)
    assert not any(law.is_extended for law in found.laws[:1])
    assert term(found.laws[0]) == "u: u**2"
