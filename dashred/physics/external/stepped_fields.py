"""The fields that a program steps; the others have equations."""

from __future__ import annotations

from dashred.physics.system_schema import System


def stepped_fields(config: System) -> tuple[str, ...]:
    """Return the fields that the program of a system steps, in the order of the state."""
    assert config.simulator is not None
    own = config.simulator.fields
    return tuple(name for name in config.fields if own is None or name in own)
