"""The problem of a recording with one episode, without a limit of time."""

from __future__ import annotations

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.run import provenance


def single_episode(config: Config) -> Problem:
    """Return the problem.

    Raises:
        InputError: the recording has several episodes.
    """
    provenance.prepare_torch(config)
    problem = build_problem(config).without_budget()
    if problem.others:
        fault = "the other methods read one episode, and the recording has several"
        raise InputError(fault, where=config.recording.path)
    return problem
