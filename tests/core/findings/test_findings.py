"""Findings files: reproducible bytes, atomic writes and detection of changes."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.core.findings.findings import (
    canonical,
    check_freeze,
    freeze,
    versions,
    write_json_atomic,
)
from dashred.core.findings.fit_schema import errors_by_method
from dashred.core.findings.input_schema import Input
from dashred.core.findings.methods import current_names, with_deprecated
from dashred.core.findings.schema import Findings, new_findings

SOURCE = Input(
    config={"seed": 1},
    config_sha256="c",
    recording_sha256="r",
    seed=1,
    versions={},
    library_size=None,
    splits=None,
)


def test_the_same_contents_give_the_same_bytes_whatever_the_order(tmp_path: Path) -> None:
    write_json_atomic(tmp_path / "a.json", {"b": 1.0, "a": [1, 2.5]})
    write_json_atomic(tmp_path / "b.json", {"a": (1, 2.5), "b": 1.0 + 1e-12})
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert (tmp_path / "a.json").read_bytes().endswith(b"}\n")


def test_text_is_written_as_it_reads(tmp_path: Path) -> None:
    write_json_atomic(tmp_path / "a.json", {"says": "λ falls"})
    assert (tmp_path / "a.json").read_text(encoding="utf-8") == '{\n  "says": "λ falls"\n}\n'


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1.23456789012, 1.2345679),
        (1.5e-300, 1.5e-300),
        (math.nan, None),
        (-math.inf, None),
        (np.float32(0.1), 0.1),
        (np.array([[1, 2]]), [[1, 2]]),
        (np.bool_(True), True),
        (np.array([np.nan, 0.5]), [None, 0.5]),
        ({"a": {"b": (None, "x")}}, {"a": {"b": [None, "x"]}}),
    ],
)
def test_values_become_plain_json(value: object, expected: object) -> None:
    assert canonical(value) == expected


def test_minus_zero_has_one_spelling() -> None:
    assert json.dumps(canonical(-0.0)) == "0.0"


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_rounding_is_small_and_done_once(value: float) -> None:
    rounded = canonical(value)
    assert rounded == pytest.approx(value, rel=1e-7)
    assert canonical(rounded) == rounded


@pytest.mark.parametrize("value", [{1: "a"}, {1, 2}, Path("a"), b"bytes"])
def test_what_json_holds_in_no_single_way_is_refused(value: object) -> None:
    with pytest.raises(TypeError):
        canonical(value)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "findings.json"
    write_json_atomic(path, {"verdict": None})
    before = path.read_bytes()
    with pytest.raises(TypeError):
        write_json_atomic(path, {"verdict": {1, 2}})
    with pytest.raises(UnicodeEncodeError):
        write_json_atomic(path, {"verdict": "\ud800"})
    assert [file.name for file in tmp_path.iterdir()] == ["findings.json"]
    assert path.read_bytes() == before


def test_what_was_not_looked_for_is_null() -> None:
    found = new_findings(SOURCE)
    assert set(found) == set(Findings.__annotations__) - {"units", "budget", "hidden_state"}
    given = {"fit", "latent", "input", "also_supported", "fitted_parameters"}
    assert {key for key, value in found.items() if value is not None} == given
    assert found["also_supported"] == [] and found["fitted_parameters"] == []
    assert found["fit"]["comparisons"] == []
    assert found["fit"]["test_sensors"] == errors_by_method()
    assert set(errors_by_method().values()) == {None}
    assert found["latent"] == {"alg1": None, "alg2": None}


def test_errors_are_null_where_unknown_and_unknown_methods_are_refused() -> None:
    assert errors_by_method(shred=0.2)["shred"] == 0.2
    assert errors_by_method(shred=0.2)["dashred"] is None
    with pytest.raises(TypeError, match="shreed"):
        errors_by_method(shreed=0.2)
    with pytest.raises(TypeError, match="after"):
        errors_by_method(after=0.2)


def test_the_deprecated_names_of_methods_repeat_the_values() -> None:
    errors = errors_by_method(
        simulation_same_start=0.4, simulation_refit=0.3, corrected=0.1, nearest_snapshots=0.5
    )
    assert (errors["before"], errors["before_refit"], errors["after"]) == (0.4, 0.3, 0.1)
    assert errors["snapshots"] == 0.5 and "snapshots" not in errors_by_method()
    old = {"before": 0.4, "before_refit": 0.3, "after": None, "shred": 0.2}
    new = {"simulation_same_start": 0.4, "simulation_refit": 0.3, "corrected": None, "shred": 0.2}
    assert current_names(old) == new == current_names(with_deprecated(new))


@pytest.fixture
def frozen(tmp_path: Path) -> Path:
    write_json_atomic(tmp_path / "findings.json", new_findings(SOURCE))
    (tmp_path / "corrected.yaml").write_text("system: {}\n", encoding="utf-8")
    freeze(tmp_path, ["corrected.yaml"])
    return tmp_path


def test_an_untouched_freeze_holds(frozen: Path) -> None:
    contents = json.loads((frozen / "freeze.json").read_text(encoding="utf-8"))
    assert set(contents) == {"sha256", "files", "time"}
    assert set(contents["files"]) == {"findings.json", "corrected.yaml"}
    check_freeze(frozen)


@pytest.mark.parametrize("name", ["findings.json", "corrected.yaml"])
def test_a_file_changed_by_one_byte_is_noticed(frozen: Path, name: str) -> None:
    data = bytearray((frozen / name).read_bytes())
    data[3] ^= 1
    (frozen / name).write_bytes(data)
    with pytest.raises(InputError, match="changed after it was frozen") as caught:
        check_freeze(frozen)
    assert caught.value.where == str(frozen / name)


def test_a_frozen_file_that_is_gone_is_noticed(frozen: Path) -> None:
    (frozen / "corrected.yaml").unlink()
    with pytest.raises(InputError, match="is missing"):
        check_freeze(frozen)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"sha256": "a", "files": {}}', "\xff"])
def test_a_broken_freeze_is_refused(frozen: Path, text: str) -> None:
    (frozen / "freeze.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match="not a valid freeze"):
        check_freeze(frozen)


def test_findings_that_were_never_frozen_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not been frozen"):
        check_freeze(tmp_path)


def test_versions_name_what_the_numbers_depend_on() -> None:
    assert {"python", "torch", "numpy", "lightning", "mlflow", "pysindy"} <= versions().keys()


def test_findings_and_tracking_import_neither_torch_nor_mlflow() -> None:
    code = (
        "import sys, dashred.core.findings.findings, dashred.core.mlflow.tracker;"
        "import dashred.reporting.text.summary;"
        "sys.exit(bool({'torch', 'mlflow', 'lightning', 'matplotlib'} & sys.modules.keys()))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
