"""The page of all rows, ``docs/networks.md``."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from dashred.core.templates import render
from dashred.evaluation.baselines.assimilations import VARIANTS
from dashred.evaluation.networks.rows import (
    DYNAMICS,
    SHRED,
    SIMULATION,
    LawScore,
    Row,
    hides_a_law,
    is_exact,
    ratio,
)
from dashred.evaluation.proof.scoring.statistics import Rate

TEMPLATE = "evaluation/networks/templates/networks.md.j2"
# Ratios that are aimed at: to SHRED, to the simulation without corrections, and at most to SHRED.
TO_SHRED, TO_SIMULATION, NO_WORSE = 0.5, 0.1, 1.05
METHODS = (SIMULATION, SHRED, *VARIANTS)
# What the errors of the steps are measured in.
RESIDUALS = {"fields": "fields", "alg1": "latent, Algorithm 1", "alg2": "latent, Algorithm 2"}
LAWS = ("alg1", "alg2", *(name for name, variant in VARIANTS.items() if variant.dynamics))


def document(rows: Sequence[Row]) -> str:
    """Return the page as Markdown."""
    rows = sorted(rows, key=lambda row: (row["noise"], row["system"], row["twin"], row["seed"]))
    done = [row for row in rows if row["problem"] is None]
    return render(
        TEMPLATE,
        counts=[_counts(done, noise) for noise in sorted({row["noise"] for row in done})],
        variants=[_variant(name, done) for name in VARIANTS],
        laws=[_proposals(name, done) for name in LAWS],
        lines=[_line(row) for row in rows],
    )


def _counts(done: Sequence[Row], noise: float) -> list[str]:
    """Return what the page says of the assimilation with dynamics at one noise."""
    rows = [row for row in done if row["noise"] == noise]
    hiding = [row for row in rows if hides_a_law(row)]
    systems = sorted({row["system"] for row in hiding})
    by_system = [[row for row in hiding if row["system"] == system] for system in systems]

    def near(reference: str, limit: float) -> str:
        below = [median(ratio(r, DYNAMICS, reference) for r in own) <= limit for own in by_system]
        return f"{sum(below)} of {len(below)}"

    worst = max(ratio(row, DYNAMICS, SHRED) for row in rows)
    nulls = [row["laws"][DYNAMICS] for row in rows if not hides_a_law(row)]
    return [
        f"{100 * noise:g} %",
        str(len(rows)),
        near(SHRED, TO_SHRED),
        near(SIMULATION, TO_SIMULATION),
        f"{worst:.2f}",
        str(Rate.of(is_exact(row["laws"][DYNAMICS]) for row in hiding)) if hiding else "none",
        str(Rate.of(is_exact(law) for law in nulls)) if nulls else "none",
    ]


def _variant(name: str, done: Sequence[Row]) -> list[str]:
    """Return the row of a variant: what it has, and the ratio of its error to SHRED's."""
    done = [row for row in done if name in row["rmse"]]
    found = [ratio(row, name, SHRED) for row in done]
    variant = VARIANTS[name]
    return [
        *("yes" if on else "no" for on in (variant.dynamics, variant.adapter, variant.random_laws)),
        RESIDUALS[variant.residual] if variant.dynamics else "",
        str(len(found)),
        f"{median(found):.2g}" if found else "",
        str(sum(r <= TO_SHRED for r in found)),
        str(sum(r > NO_WORSE for r in found)),
        f"{median(row['seconds'][name] for row in done):.0f}" if found else "",
    ]


def _proposals(name: str, done: Sequence[Row]) -> list[str]:
    found = [(hides_a_law(row), row["laws"][name]) for row in done if name in row["laws"]]
    exact = [is_exact(law) for hides, law in found if hides]
    nulls = [is_exact(law) for hides, law in found if not hides]
    return [
        name.replace("_", " "),
        str(Rate.of(exact)) if exact else "",
        str(Rate.of(nulls)) if nulls else "",
    ]


def _line(row: Row) -> list[str]:
    case = [row["system"], row["twin"], str(row["seed"]), f"{100 * row['noise']:g} %"]
    if row["problem"] is not None:
        return [*case, row["problem"], *[""] * (len(METHODS) + 1)]
    errors = [f"{row['rmse'][name]:.2g}" if name in row["rmse"] else "" for name in METHODS]
    return [*case, *errors, f"{ratio(row, DYNAMICS, SHRED):.2g}", _law(row["laws"][DYNAMICS])]


def _law(law: LawScore) -> str:
    if is_exact(law):
        error = "" if law["error"] is None else f", within {100 * law['error']:.2g} %"
        return f"exact{error}"
    parts = [f"{law['missed']} missed"] if law["missed"] else []
    if law["spurious"]:
        parts.append(f"{law['spurious']} too many")
    return ", ".join(parts)
