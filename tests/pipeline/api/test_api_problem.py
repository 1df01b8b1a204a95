"""A problem is made from names, files and dicts, and checks what it is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
import yaml

import dashred
from dashred.config import config_sha256
from tests.conftest import QUICK


def test_a_dict_is_the_system_that_its_file_is(quick: Path, recorded: xr.Dataset) -> None:
    values = yaml.safe_load(QUICK)
    values["recording"].pop("twin")
    ours = dashred.Problem.from_dict(values, recording=recorded)
    assert config_sha256(ours.config) == config_sha256(
        dashred.Problem.from_yaml(quick, recording=recorded).config
    )
    np.testing.assert_array_equal(
        ours.simulate()["u"], dashred.Problem.from_yaml(quick, recording=recorded).simulate()["u"]
    )


def test_overrides_are_dotted_or_nested(quick: Path) -> None:
    dotted = dashred.Problem.from_yaml(quick, overrides={"shred.lags": 3, "seed": np.int64(2)})
    nested = dashred.Problem.from_yaml(quick, overrides={"shred": {"lags": 3}, "seed": 2})
    assert (dotted.config.shred.lags, dotted.config.seed) == (3, 2)
    assert config_sha256(dotted.config) == config_sha256(nested.config)


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        ({"shred.lagss": 3}, r"overrides: .*lagss(.|\n)*lags"),
        ({"shred.lags": "many"}, "overrides: .*shred.lags must be"),
        ({"shred.lags": [1]}, "overrides: .*shred.lags must be"),
        ({"shred.lags": object()}, "overrides, shred.lags: .*type object"),
        ({"system.parameters.nuu": 1}, "overrides: .*nuu"),
        ({"resolution_limit": float("nan")}, "must be finite"),
        ({"output": "out"}, "overrides: output cannot be set here\n  Result.save"),
        ({"tracking.root": "runs"}, "tracking cannot be set here"),
        ({3: 4}, "a key must be a name, not 3"),
        ({"system": 1, "system.title": "x"}, "given as a value"),
    ],
)
def test_wrong_overrides(quick: Path, overrides: dict[str, object], says: str) -> None:
    with pytest.raises(dashred.InputError, match=says):
        dashred.Problem.from_yaml(quick, overrides=overrides)


def test_an_unknown_system_is_told_as_on_the_command_line() -> None:
    with pytest.raises(
        dashred.InputError, match=r"unknown conf 'rdee'(.|\n)*did you mean conf=rde"
    ):
        dashred.Problem.from_yaml("rdee")


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ([], "dict: expected a dict"),
        ({"system": {"title": "x"}}, "dict.*missing: system.equations"),
        ({"sistem": {}}, "dict, sistem: .*sistem"),
        ({"system": {"fields": {"u": "u"}, "equations": {"u": "-w"}}}, "missing"),
    ],
)
def test_wrong_dicts(values: dict[str, object], says: str) -> None:
    with pytest.raises(dashred.InputError, match=says):
        dashred.Problem.from_dict(values)


def test_a_wrong_equation_names_its_place_in_the_dict() -> None:
    values = yaml.safe_load(QUICK)
    values["system"]["equations"]["u"] = "-nuu*u"
    with pytest.raises(dashred.InputError, match=r"dict, system.equations.u: (.|\n)*'nuu'"):
        dashred.Problem.from_dict(values)


def test_the_check_is_the_command_s(quick: Path, recorded: xr.Dataset) -> None:
    check = dashred.Problem.from_yaml(quick, recording=recorded).check()
    assert "41 samples of 6 sensors" in str(check) and repr(check) == str(check)
    assert (check.errors, check.left_to_do) == (0, 0) and check.warnings > 0
    assert check._repr_html_().startswith("<pre>Burgers")


def test_a_check_needs_no_recording(quick: Path) -> None:
    assert "There is no recording yet" in str(dashred.Problem.from_yaml(quick).check())


def test_a_run_needs_one(quick: Path) -> None:
    problem = dashred.Problem.from_yaml(quick)
    assert "no recording" in repr(problem) and problem.recording is None
    with pytest.raises(dashred.InputError, match=r"nothing to analyse(.|\n)*xarray.Dataset"):
        problem.discover()


def test_a_seed_is_checked(quick: Path, recorded: xr.Dataset) -> None:
    with pytest.raises(dashred.InputError, match=r"overrides: .*seed must be"):
        dashred.Problem.from_yaml(quick, recording=recorded).discover(seed=-1)


def test_the_simulator_runs_on_the_recording_s_clock(quick: Path, recorded: xr.Dataset) -> None:
    run = dashred.Problem.from_yaml(quick, recording=recorded).simulate()
    assert run["u"].dims == ("time", "x")
    np.testing.assert_array_equal(run["time"], recorded["time"])
    x = run["x"].to_numpy()
    np.testing.assert_allclose(run["u"][0], 1 + 0.5 * np.sin(x))


def test_the_simulator_runs_from_any_start(swing: pd.DataFrame) -> None:
    problem = dashred.Problem.from_yaml("pendulum", recording=swing)
    run = problem.simulate(start={"theta": 0.1, "omega": 0.0}, times=np.linspace(0, 1, 11))
    # A small swing is harmonic, with the frequency that the configuration states.
    np.testing.assert_allclose(run["theta"], 0.1 * np.cos(8.01 * run["time"]), atol=2e-3)
    assert run["theta"].attrs["units"] == "rad" and run["time"].attrs["units"] == "s"


@pytest.mark.parametrize(
    ("start", "times", "says"),
    [
        ({"theta": 0.1}, None, "start: the field 'omega' is missing"),
        ({"theta": 0.1, "omega": 0, "phi": 1}, None, "no field 'phi'"),
        ({"theta": [1, 2], "omega": 0}, None, "the shape"),
        ({"theta": "much", "omega": 0}, None, "finite numbers"),
        (3.0, None, "a start cannot be of the type float"),
        (None, [1.0, 0.5], "times: times must be"),
        (None, [], "times: times must be"),
        (None, "soon", "times: finite numbers"),
        (None, [-1.0, 0.5], "before the start"),
    ],
)
def test_wrong_runs(swing: pd.DataFrame, start: object, times: object, says: str) -> None:
    problem = dashred.Problem.from_yaml("pendulum", recording=swing)
    with pytest.raises(dashred.InputError, match=says):
        problem.simulate(start=start, times=times)  # type: ignore[arg-type]
