"""What rows of a comparison come to: ratios of RMSE, and terms found, spurious and missed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from dashred.benchmark.record import Record
from dashred.comparison.method_scores import Compared

# The field that errors are told relative to: the simulator as it is, from the same start.
REFERENCE = "simulation_same_start"
FIELDS = {
    "simulation": "simulation, nominal start",
    "simulation_same_start": "simulation, same start",
    "simulation_refit": "simulation, best start",
    "optimal_interpolation": "optimal interpolation",
    "closed_form": "closed form of linear systems",
    "filter_state": "ensemble Kalman filter",
    "filter_augmented": "the same, with coefficients",
    "shred_plain": "SHRED, plain",
    "shred": "SHRED, randomised",
    "dashred": "DA-SHRED",
    "corrected": "dashred: corrected simulator",
    "corrected_shred": "dashred: corrected SHRED",
}
LAWS = {
    "latent_alg1": "latent SINDy, Algorithm 1",
    "latent_alg2": "latent SINDy, Algorithm 2",
    "filter_augmented": "ensemble Kalman filter with coefficients",
    "closed_form": "closed form of linear systems",
    "pde_find": "PDE-FIND, given the full noisy field",
    "corrected": "dashred",
}


@dataclass(frozen=True)
class ComparedRow:
    """One experiment.

    Attributes:
        record: of the bench.
        methods: how right each method is.
        folder: where its files are.
    """

    record: Record
    methods: dict[str, Compared]
    folder: Path

    def ratio(self, method: str) -> float | None:
        """Return a method's RMSE over the reference's."""
        rmse, reference = (self.methods.get(name) for name in (method, REFERENCE))
        if not rmse or not reference or rmse["rmse"] is None or not reference["rmse"]:
            return None
        return rmse["rmse"] / reference["rmse"]


@dataclass(frozen=True)
class LawCount:
    """Terms over some rows.

    Attributes:
        rows: in which the method looked for a law.
        exact: of them, where it found all terms and no others.
        found: true terms found.
        spurious: terms found that are not there.
        missed: true terms not found.
        error: median over rows of the worst relative error of the coefficients found.
    """

    rows: int
    exact: int
    found: int
    spurious: int
    missed: int
    error: float | None


def own_layout(rows: Iterable[ComparedRow]) -> list[ComparedRow]:
    """Return the rows with the system's own number of sensors."""
    return [r for r in rows if r.record["sensors"] is None and r.record["extra"] is None]


def groups(rows: Sequence[ComparedRow]) -> dict[tuple[str, float], list[ComparedRow]]:
    """Return the rows by system and noise, in the order in which they first come."""
    found: dict[tuple[str, float], list[ComparedRow]] = {}
    for row in rows:
        found.setdefault((row.record["system"], row.record["noise"]), []).append(row)
    return found


def median_ratio(rows: Iterable[ComparedRow], method: str) -> float | None:
    """Return the median over rows that hide a law: for others there is nothing to gain."""
    ratios = [row.ratio(method) for row in rows if row.record["law"]]
    known = [ratio for ratio in ratios if ratio is not None]
    return median(known) if known else None


def count_laws(rows: Iterable[ComparedRow], method: str) -> LawCount | None:
    """Return what a method's laws come to; None where it looked for none."""
    told = [row.methods[method] for row in rows if method in row.methods]
    laws = [one for one in told if one["found"] is not None]
    if not laws:
        return None
    errors = [one["coefficient_error"] for one in laws if one["coefficient_error"] is not None]
    return LawCount(
        rows=len(laws),
        exact=sum(not one["spurious"] and not one["missed"] for one in laws),
        found=sum(one["found"] or 0 for one in laws),
        spurious=sum(one["spurious"] or 0 for one in laws),
        missed=sum(one["missed"] or 0 for one in laws),
        error=median(errors) if errors else None,
    )


def as_metrics(rows: Sequence[ComparedRow]) -> dict[str, float]:
    """Return the median ratios by name: ``rde/noise 0.05/ratio/corrected``."""
    return {
        f"{system}/noise {noise:g}/ratio/{method}": ratio
        for (system, noise), group in groups(rows).items()
        for method in FIELDS
        if (ratio := median_ratio(group, method)) is not None
    }
