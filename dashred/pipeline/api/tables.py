"""Tables of the terms, of the fitted parameters and of the alternative laws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from dashred.reporting.text.laws import alternative_text
from dashred.reporting.text.regions import extent
from dashred.reporting.text.support import has_probabilities

TERMS = (
    *("equation", "term", "coefficient", "std", "low", "high", "unit"),
    *("from", "to", "inclusion", "acts", "says"),
)
FITTED = ("parameter", "value", "std", "low", "high", "stated", "spread", "unit", "exact")
ALTERNATIVES = ("law", "delta_bic", "rival", "same_as_best")


def terms_table(findings: Mapping[str, Any]) -> pd.DataFrame:
    """Return a table with one row for each term of the law.

    The columns are ``equation`` (None for a parameter); ``term``; ``coefficient`` and its ``std``;
    the bounds ``low`` and ``high`` of the 95 % interval (for a parameter, of its new value); the
    ``unit`` of the coefficient if it is known; the old and the new value of a parameter, ``from``
    and ``to``; ``inclusion``, the probability that the term belongs to the law; ``acts``, where the
    term acts; and ``says``, a description in words. The probability is missing if held-out data do
    not confirm the law, or if it is only the nearest to what is missing.
    """
    units = findings.get("units", {})
    rows = []
    for term in findings["terms"] or []:
        low, high = term["ci95"]
        where = {"region": term["region"], "regime": None}
        rows.append({**term, "low": low, "high": high, "acts": extent(where, units)})
    table = pd.DataFrame(rows, columns=list(TERMS))
    return table if has_probabilities(findings) else table.assign(inclusion=None)


def fitted_parameters_table(findings: Mapping[str, Any]) -> pd.DataFrame:
    """Return a table with one row for each parameter that is stated with a spread.

    The columns are ``parameter``; its fitted ``value`` and its ``std``; the bounds ``low`` and
    ``high`` of the 95 % interval; the ``stated`` value and its ``spread``; the ``unit`` if it is
    known; and ``exact``, False for a value that is correct to first order.
    """
    rows = []
    for each in findings.get("fitted_parameters", ()):
        low, high = each["ci95"]
        rows.append({**each, "low": low, "high": high})
    return pd.DataFrame(rows, columns=list(FITTED))


def alternatives_table(findings: Mapping[str, Any]) -> pd.DataFrame:
    """Return a table with one row for each alternative law.

    The columns are ``law``, a description in words; ``delta_bic``, the difference from the best
    law; ``rival``, whether the recording cannot exclude it; and ``same_as_best``, whether it gives
    the same sensor readings as the best law.
    """
    rows = [{**other, "law": alternative_text(other)} for other in findings["alternatives"] or []]
    return pd.DataFrame(rows, columns=list(ALTERNATIVES))
