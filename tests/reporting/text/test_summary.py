"""The summary says what the findings say, in words, and survives what is null."""

import io
from typing import Any

from rich.console import Console

from dashred.core.findings.cause_schema import Cause
from dashred.core.findings.fit_schema import Fit, errors_by_method
from dashred.core.findings.input_schema import Input, Splits
from dashred.core.findings.schema import Latent, LatentSindy, new_findings
from dashred.reporting.page.html import page
from dashred.reporting.text.summary import _basis, print_summary, summary

SPLITS = Splits(
    inputs=["a", "b", "c"],
    extra=["d"],
    validate=["e"],
    test=["f", "g"],
    time_end=8.0,
    note="roles are drawn from the seed",
)
SOURCE = Input(
    config={"system": {"title": "Rotating detonation engine"}},
    config_sha256="c",
    recording_sha256="r",
    seed=7,
    versions={},
    library_size=None,
    splits=SPLITS,
)


def findings_with(latent: Latent | None = None, **errors: float) -> Any:
    fit = Fit(
        comparisons=[],
        noise_std=None,
        noise_correlation=None,
        own_error=None,
        chi2=None,
        unexplained=None,
        misfit_at_test_sensors=None,
        test_sensors=errors_by_method(**errors),
        heldout_time=errors_by_method(),
        heldout_restarted=errors_by_method(),
    )
    return new_findings(SOURCE, fit=fit, latent=latent)


def test_what_was_compared_comes_first() -> None:
    lines = summary(findings_with(), None, {}).splitlines()
    assert lines[0].startswith("Rotating detonation engine:")
    assert "seed 7" in lines[0]
    assert "4 sensors for the fit (3 inputs of SHRED), 1 for validation, 2 for the test" in lines[1]
    assert "the fit ends at time 8." in lines[1]
    assert lines[2] == "Roles are drawn from the seed."


def test_an_improvement_and_a_harm_are_called_what_they_are() -> None:
    better = summary(findings_with(shred=0.4, dashred=0.3), None, {})
    assert "Assimilation lowered SHRED's error by 25 %." in better
    worse = summary(findings_with(shred=0.4, dashred=0.5), None, {})
    assert "Assimilation raised SHRED's error by 25 %." in worse
    same = summary(findings_with(shred=0.4, dashred=0.4), None, {})
    assert "by less than 1 %" in same


def test_the_truth_is_spoken_of_only_where_a_score_is() -> None:
    found = findings_with(simulation=0.8)
    assert "hidden truth" not in summary(found, None, {})
    text = summary(found, {"field_rmse": {"simulation": 0.71, "shred": None}}, {})
    assert "hidden truth" in text
    assert "0.71" in text
    assert "SHRED  " not in text


def test_proposals_are_ranked_and_called_proposals() -> None:
    terms: list[Any] = [
        {"equation": "u", "term": f"u**{k}", "coefficient": 0.1 * k, "inclusion": 0.9, "rank": k}
        for k in range(7, 0, -1)
    ]
    alg1 = LatentSindy(proposals=terms, rmse_path=[])
    alg2 = LatentSindy(proposals=[], rmse_path=[])
    text = summary(findings_with(Latent(alg1=alg1, alg2=alg2)), None, {})
    assert "to be tested, not a verdict" in text
    assert text.index("1. +0.1 · u**1") < text.index("2. +0.2 · u**2")
    assert "in the equation of u, in 90 % of the resamples" in text
    assert "u**6" not in text
    assert "and 2 more" in text
    assert "Algorithm 2: no term" in text


def test_a_change_of_a_parameter_is_a_proposal() -> None:
    nothing = LatentSindy(proposals=[], rmse_path=[])
    dynamics = LatentSindy(proposals=[], rmse_path=[], parameters={"nu": -0.012})
    latent = Latent(alg1=nothing, alg2=nothing, dynamics=dynamics)
    text = summary(findings_with(latent), None, {})
    assert "with dynamics:\n    the parameter nu changes by -0.012" in text


def test_a_verdict_is_put_in_words() -> None:
    text = "doubling changes the traces by 3 %"
    cause: Cause = {"kind": "unresolved-numerics", "probability": 1.0, "says": text}
    found = new_findings(SOURCE | {"splits": None}, verdict="unresolved-numerics", causes=[cause])
    text = summary(found, None, {})
    assert "Verdict: unresolved-numerics: the simulation is not resolved" in text
    assert "Doubling changes the traces by 3 %." in text
    assert "RMSE" not in text
    assert "None" not in text


def test_where_things_are_comes_last() -> None:
    text = summary(findings_with(), None, {"findings": "/a/findings.json", "ui": "make ui"})
    assert text.endswith("findings  /a/findings.json\nui        make ui\n")


def test_brackets_in_names_are_printed_as_they_are() -> None:
    console = Console(file=io.StringIO(), width=80)
    print_summary("sensor [red]u[/red]\n", console)
    assert "sensor [red]u[/red]" in console.file.getvalue()  # type: ignore[attr-defined]


def test_a_simulation_less_exact_than_its_sensors_says_what_to_do() -> None:
    told = [summary(doubtful(error), None, {}) for error in (None, 0.9, 2.44)]
    assert ["halve the time step" in text for text in told] == [False, False, True]
    assert "of the corrected simulation is 2.4 times the residuals of the fit" in told[2]
    assert "halve the time step" in page(doubtful(2.44), {}, "")


def test_a_time_step_that_suffices_is_told() -> None:
    found = doubtful(2.44)
    found["fit"]["sufficient_dt"] = 0.32
    told = summary(found, None, {})
    assert "set system.integrator.dt to 0.32, and run again" in told
    assert "halve the time step" not in told


def test_a_simulation_that_is_lost_has_no_error_in_numbers() -> None:
    found = doubtful(1e6)
    found["fit"]["failure"] = "3 of 40 steps failed, the last one: function f returns nan"
    told = summary(found, None, {})
    assert "does not stay finite." in told
    assert "The simulator: 3 of 40 steps failed, the last one: function f returns nan." in told
    assert "1e+06" not in told


def test_a_law_that_diverges_and_a_step_that_it_needs_are_told() -> None:
    found = doubtful(None)
    found["fit"] |= {"diverges": 8.06, "corrected_dt": 0.0125}
    for told in (summary(found, None, {}), page(found, {}, "")):
        assert "diverges at t = 8.06, also with shorter time steps" in told
        assert "corrected.yaml has a time step of 0.0125" in told
    assert "the law itself diverges" not in summary(doubtful(None), None, {})


def doubtful(error: float | None) -> Any:
    found = findings_with()
    found["verdict"], found["causes"] = "missing-term", []
    found["fit"]["own_error"] = error
    return found


def test_what_the_modes_cannot_express_is_told() -> None:
    assert _basis(None) == _basis(1e-4) == []
    [line] = _basis(0.0123)
    assert line == (
        "The modes of SHRED cannot express 0.012 standard deviations (RMS) of the corrected field."
    )
