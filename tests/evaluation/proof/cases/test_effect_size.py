"""Recording a case: what is hidden has the effect that was drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dashred.data.observation_operator import ObservationOperator
from dashred.evaluation.proof.cases.case_record import Kind
from dashred.evaluation.proof.cases.draw import Case
from dashred.evaluation.proof.cases.effect_size import record_truth
from dashred.evaluation.twins.recorder import run_truth


def case_of(kind: Kind, effect: float | None = None, **hidden: Any) -> Case:
    """Return a case of the proof's smallest system."""
    entry = {"terms": []} | hidden
    return Case(3, "cases", "fhn", kind, (7, 0, 3), 0.03, 10, entry, effect)


TERM = {"equation": "v", "term": "v**2", "coefficient": 1.0}


@pytest.mark.parametrize("effect", [2.0, 10.0])
def test_a_law_moves_the_sensors_by_what_was_drawn(effect) -> None:
    concealed = record_truth(case_of("terms", effect, terms=[TERM]))
    assert concealed.effect == pytest.approx(effect, rel=0.25)
    # Under the true law the simulator itself reads what the truth does, far below the noise.
    assert 0 < concealed.numerics < 0.5
    [term] = concealed.truth.terms
    assert (term.equation, term.term) == ("v", "v**2") and term.coefficient > 0


def test_a_term_that_begins_at_nothing_is_sized_by_the_whole_record() -> None:
    term = {"equation": "v", "term": "sin(0.5*t)", "coefficient": 1.0}
    concealed = record_truth(case_of("outside", 5.0, terms=[term]))
    assert concealed.effect == pytest.approx(5.0, rel=0.25)


def test_a_stronger_effect_is_a_larger_coefficient_of_the_same_case() -> None:
    weak, strong = (record_truth(case_of("terms", effect, terms=[TERM])) for effect in (2.0, 8.0))
    ratio = strong.truth.terms[0].coefficient / weak.truth.terms[0].coefficient
    assert 2.0 < ratio < 8.0
    assert np.array_equal(weak.truth.states[0], strong.truth.states[0])


def test_the_noise_is_that_which_was_drawn() -> None:
    concealed = record_truth(case_of("null"))
    operator = ObservationOperator(concealed.recording.sensors, concealed.system)
    clean = operator(concealed.truth.states)[: len(concealed.recording.times)].numpy()
    stated = np.array([sensor.std for sensor in concealed.recording.sensors])
    z = (concealed.recording.values - clean) / stated
    assert z.std() == pytest.approx(1.0, abs=4 / math.sqrt(2 * z.size))


def test_a_case_is_recorded_again_to_the_same_values() -> None:
    case = case_of("fault", 5.0, faults=[{"sensor": 0.4, "kind": "drift", "value": 1.0}])
    first, again = record_truth(case), record_truth(case)
    assert np.array_equal(first.recording.values, again.recording.values)
    assert first.truth.concealed == again.truth.concealed
    other = record_truth(replace(case, key=(8, 0, 3)))
    assert not np.array_equal(first.recording.values, other.recording.values)


@pytest.mark.parametrize("kind", ["bias", "drift", "stuck", "spikes", "misplaced"])
def test_a_fault_stands_at_a_sensor_that_the_analysis_fits(kind) -> None:
    from dashred.data.splits import split_recording

    case = case_of("fault", 6.0, faults=[{"sensor": 0.99, "kind": kind, "value": -1.0}])
    concealed = record_truth(case)
    [fault] = concealed.truth.concealed.faults
    split = split_recording(concealed.recording, concealed.config.splits, case.number)
    assert fault.kind == kind and fault.sensor in split.fit.names


def test_a_mis_stated_parameter_changes_the_truth_and_no_term_does() -> None:
    concealed = record_truth(case_of("parameter", 5.0, parameters={"c": -1.0}))
    assert concealed.truth.concealed.parameters["c"] < 1.0
    assert not concealed.truth.terms
    start = concealed.truth.states[0]
    fine = concealed.system.grid.interpolate(start[None], concealed.system.refined().grid)
    plain = run_truth(concealed.system, fine, concealed.truth.times[:40])
    assert not np.allclose(plain, concealed.truth.states[:40], atol=1e-3)


def test_a_parameter_that_masks_a_law_takes_away_most_of_what_it_does() -> None:
    case = case_of("masked", 5.0, terms=[TERM], masked_by="b")
    concealed = record_truth(case)
    assert concealed.effect == pytest.approx(5.0, rel=0.25)
    [term], parameters = concealed.truth.terms, concealed.truth.concealed.parameters
    assert set(parameters) == {"b"} and term.coefficient != 0
    alone = {"equation": "v", "term": "v**2", "coefficient": 1.0}
    weak = record_truth(replace(case, hidden={"terms": [alone]}))
    # As large a law as this would show far more, were it not masked.
    assert abs(term.coefficient) > 2 * abs(weak.truth.terms[0].coefficient)
