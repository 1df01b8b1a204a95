"""The outcomes of a case.

- right: a definite verdict that is true, and what it names is exact;
- listed: the findings say that they are uncertain, and the truth is among what they list;
- flagged: they say that they are uncertain, and do not list the truth;
- silent-wrong: a definite verdict that is wrong;
- no-answer: no findings.
"""

from __future__ import annotations

from typing import Literal

Outcome = Literal["right", "listed", "flagged", "silent-wrong", "no-answer"]
OUTCOMES: tuple[Outcome, ...] = ("right", "listed", "flagged", "silent-wrong", "no-answer")
