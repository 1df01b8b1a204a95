"""What the budget of a run did not suffice for, in the findings."""

from __future__ import annotations

from dashred.core.budget import Budget
from dashred.core.findings.cause_schema import Cause
from dashred.core.findings.schema import Findings, SpentBudget


def note_budget(findings: Findings, budget: Budget) -> None:
    """Add what was left out to the findings, if anything was."""
    if budget.not_tried:
        findings["budget"] = SpentBudget(
            seconds=budget.seconds,
            spent=float(round(budget.spent)),
            cpu=float(round(budget.cpu)),
            not_tried=list(budget.not_tried),
        )


def blame_budget(cause: Cause, budget: Budget) -> None:
    """Give the budget as the reason why a search did not converge, if it was cut short."""
    if budget.not_tried:
        cause["reason"], cause["budget"] = "budget", budget.seconds
