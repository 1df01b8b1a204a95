"""An uncertain parameter must have an effect that can be fitted."""

from pathlib import Path

import pytest

from dashred.config import Config, load_config
from dashred.core.errors import InputError

TEXT = """system:
  title: tank
  fields: {h: level}
  parameters: {k: 0.1, limit: {value: 0.8, spread: 0.1}}
  let: {outflow: k*h}
  equations: {h: 1 - outflow}
  start: {h: 1}
  integrator: {dt: 0.1}
recording: {path: my.csv}
"""


def load(folder: Path, old: str, new: str) -> Config:
    assert TEXT.count(old) == 1
    path = folder / "tank.yaml"
    path.write_text(TEXT.replace(old, new))
    return load_config([f"conf={path}"], entry="test")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("1 - outflow", "1 - outflow - limit"),
        ("k*h", "k*max(h - limit, 0)"),
        ("outflow: k*h", "head: h - limit, outflow: k*head"),
        ("outflow: k*h", "outflow: k*h, head: h - limit"),
    ],
)
def test_an_effect_may_come_through_lets(tmp_path: Path, old: str, new: str) -> None:
    assert load(tmp_path, old, new).system.parameter_spread == {"limit": 0.1}


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("h: 1}", "h: limit}", "limit has a spread, but no equation or let depends on it"),
        ("1 - outflow", "limit - outflow - limit", "but no equation or let depends on it"),
        ("k*h", "k*h*step(h - limit)", "limit has a spread, but it only moves a jump"),
    ],
)
def test_a_parameter_without_an_effect_is_refused(
    tmp_path: Path, old: str, new: str, what: str
) -> None:
    with pytest.raises(InputError) as caught:
        load(tmp_path, old, new)
    assert what in caught.value.what and "remove the spread" in (caught.value.hint or "")
    assert caught.value.where == f"{tmp_path / 'tank.yaml'}:4"
