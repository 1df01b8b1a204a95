"""Checks of ``system.tables``."""

from __future__ import annotations

import math
from itertools import pairwise

from dashred.config.schema.types import Where
from dashred.core.errors import InputError
from dashred.physics.system_schema import System

# A table is written out as a sum over its points in every expression that reads it.
MOST_POINTS = 200


def check_tables(system: System, where: Where) -> None:
    """Check that every table has finite points with increasing x.

    Raises:
        InputError: one does not.
    """
    for name, table in system.tables.items():
        key = f"system.tables.{name}"
        if len(table.x) != len(table.y):
            what = f"table {name} has {len(table.x)} values of x and {len(table.y)} of y"
            raise InputError(what, where=where(key), hint="give one y for each x")
        if not 2 <= len(table.x) <= MOST_POINTS:
            what = f"table {name} has {len(table.x)} points; it needs 2 to {MOST_POINTS}"
            raise InputError(what, where=where(key))
        if not all(map(math.isfinite, (*table.x, *table.y))):
            raise InputError(f"table {name} has a value that is not finite", where=where(key))
        for before, after in pairwise(table.x):
            if after <= before:
                what = f"the x of table {name} must increase; {after:g} follows {before:g}"
                raise InputError(what, where=where(key), hint="sort the points by x")
