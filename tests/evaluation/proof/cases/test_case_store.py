"""Stored cases of a draw that goes on elsewhere."""

from __future__ import annotations

import math
from dataclasses import replace

from dashred.evaluation.proof.cases.case_store import hash_of
from dashred.evaluation.proof.cases.draw import draw_cases, seed_of


def test_the_last_digit_of_a_size_does_not_make_another_case():
    cases = draw_cases(seed_of("text"), 20, 2)
    sized = [(case, case.effect) for case in cases if case.effect is not None]
    assert len(sized) > len(cases) / 2
    for case, effect in sized:
        changed = replace(case, effect=math.nextafter(effect, math.inf))
        assert changed != case
        assert hash_of(changed) == hash_of(case)
        assert hash_of(replace(case, effect=effect * 1.001)) != hash_of(case)
    assert len({hash_of(case) for case in cases}) == len(cases)
