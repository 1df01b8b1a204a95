"""The configuration of a bundled system whose equations are hidden behind a function."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from dashred.config.bundled_systems import CONF
from dashred.core.files.atomic import write_text_atomic

STEPS = "bundled_steps"
# What tells the equations, and the time step that suits them.
TELLING = ("equations", "structure", "energy")
# What describes the recording of a twin.
OF_TWIN = ("twin", "sensors", "noise", "duration", "drive", "reads", "every")


def hide_equations(name: str, recording: Path, path: Path) -> str:
    """Write the configuration of a bundled system as a program; return what it has to trust."""
    config: dict[str, Any] = yaml.safe_load((CONF / f"{name}.yaml").read_text(encoding="utf-8"))
    system = {key: value for key, value in config["system"].items() if key not in TELLING}
    for section in (system.get("integrator", {}), config.get("simulation", {})):
        section.pop("dt", None)
    function = f"{STEPS}.{name}"
    # Results that are kept on disk would be missing in the number of calls.
    config["system"] = system | {"simulator": {"function": function, "keep": False}}
    described = {k: v for k, v in config["recording"].items() if k not in OF_TWIN}
    config["recording"] = described | {"path": str(recording)}
    write_text_atomic(path, yaml.safe_dump(config, sort_keys=False, width=100))
    return function
