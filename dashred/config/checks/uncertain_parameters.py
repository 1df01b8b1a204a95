"""Check that uncertain parameters have an effect that can be fitted."""

from __future__ import annotations

from dashred.core.errors import InputError
from dashred.physics.declaration import Declaration
from dashred.physics.expressions.algebra import ZERO, names
from dashred.physics.expressions.differentiate import differentiate


def check_uncertain_parameters(declared: Declaration) -> None:
    """Check that an equation or a let changes smoothly with every parameter that has a spread.

    A program reads all parameters, but has no others for each episode.

    Raises:
        InputError: nothing depends on the parameter, or only through the place of a jump.
    """
    spreads = declared.config.parameter_spread
    if not spreads:
        return
    # A sensor may read any let.
    read = [*declared.equations.values(), *declared.lets.values()]
    equations = [declared.without_lets(expr) for expr in read]
    equations += [end.given for sides in declared.conditions.values() for end in sides.values()]
    program = declared.config.simulator is not None
    for name in spreads:
        if program and name not in declared.config.parameter_per:
            continue
        place = declared.where(f"system.parameter_spread.{name}")
        if not any(name in names(equation) for equation in equations):
            what = f"{name} has a spread, but no equation or let depends on it"
            raise InputError(what, where=place, hint="remove the spread, or use the parameter")
        if all(differentiate(equation, name) == ZERO for equation in equations):
            what = f"{name} has a spread, but it only moves a jump (step, sign, where)"
            hint = "remove the spread: the place of a jump cannot be fitted"
            raise InputError(what, where=place, hint=hint)
