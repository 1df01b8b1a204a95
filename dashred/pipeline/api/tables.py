"""What the findings say of a law, as tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from dashred.reporting.text.verdict import alternative_text, extent

TERMS = (
    *("equation", "term", "coefficient", "std", "low", "high", "unit"),
    *("from", "to", "inclusion", "acts", "says"),
)
ALTERNATIVES = ("law", "delta_bic", "rival", "same_as_best")


def terms_table(findings: Mapping[str, Any]) -> pd.DataFrame:
    """Return one row for each term of the law.

    Columns: ``equation`` (None for a parameter), ``term``, ``coefficient`` and its ``std``, ``low``
    and ``high`` of the 95 % interval (of a parameter, of its new value), the coefficient's ``unit``
    where it is known, ``from`` and ``to`` of a parameter, ``inclusion``, the probability that the
    term belongs to the law, ``acts``, where, and ``says``, in words.
    """
    units = findings.get("units", {})
    rows = []
    for term in findings["terms"] or []:
        low, high = term["ci95"]
        where = {"region": term["region"], "regime": None}
        rows.append({**term, "low": low, "high": high, "acts": extent(where, units)})
    return pd.DataFrame(rows, columns=list(TERMS))


def alternatives_table(findings: Mapping[str, Any]) -> pd.DataFrame:
    """Return one row for each other law that was weighed.

    Columns: ``law`` in words, ``delta_bic`` against the best law, whether it is a ``rival`` (then
    the recording does not decide between the two), and whether the sensors read the
    ``same_as_best`` under it.
    """
    rows = [{**other, "law": alternative_text(other)} for other in findings["alternatives"] or []]
    return pd.DataFrame(rows, columns=list(ALTERNATIVES))
