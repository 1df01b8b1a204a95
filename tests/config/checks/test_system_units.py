"""Units in a configuration: in system.units or after the description of a field."""

from pathlib import Path

import pytest

from dashred.config import config_sha256, frozen_input, load_config
from dashred.core.errors import InputError

TEXT = """system:
  title: Bead
  axes: {x: {length: 2, points: 16}}
  fields:
    u: temperature [K]
    v: rate
  parameters: {nu: 0.1}
  equations: {u: nu*lap(u), v: -v}
  start: {u: 1, v: 0}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 4, duration: 4, every: 0.1}
"""


def load(folder: Path, text: str):
    path = folder / "bead.yaml"
    path.write_text(text)
    return load_config([f"conf={path}"], entry="test")


def with_units(units: str) -> str:
    return TEXT.replace("  start:", f"  units: {units}\n  start:")


def test_a_unit_after_a_description_is_one_of_the_systems_units(tmp_path: Path) -> None:
    config = load(tmp_path, with_units("{t: s, x: m, nu: m2/s, u: K}"))
    assert config.system.fields == {"u": "temperature", "v": "rate"}
    assert config.system.units == {"t": "s", "x": "m", "nu": "m2/s", "u": "K"}
    alone = load(tmp_path, TEXT)
    assert alone.system.units == {"u": "K"}
    assert alone.where("system.units.u").endswith("bead.yaml:5")


def test_without_units_the_frozen_input_knows_of_none(tmp_path: Path) -> None:
    plain = load(tmp_path, TEXT.replace(" [K]", ""))
    assert "units" not in frozen_input(plain)["system"]
    stated = load(tmp_path, TEXT)
    assert frozen_input(stated)["system"]["units"] == {"u": "K"}
    assert config_sha256(plain) != config_sha256(stated)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("{w: m}", "bead.yaml:9: system.units names w, which the system does not have"),
        ("{nu: ''}", "bead.yaml:9: the unit of nu is empty"),
        ("{v: '[m'}", "bead.yaml:9: '[m' is not a valid unit of v"),
        ("{u: degC}", "bead.yaml:5: u is in K here, but in degC in"),
        ("[m]", "bead.yaml:9: system.units must be a section of keys"),
    ],
)
def test_units_that_make_no_sense_are_refused(tmp_path: Path, units: str, message: str) -> None:
    with pytest.raises(InputError) as error:
        load(tmp_path, with_units(units))
    assert message in str(error.value)
