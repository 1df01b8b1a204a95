"""The record in the findings of everything that determines them."""

from __future__ import annotations

import json

from dashred.config import config_sha256, frozen_input
from dashred.core.findings.findings import versions
from dashred.core.findings.input_schema import EpisodeSplit, Input, Splits
from dashred.pipeline.problem import Problem


def build_input(problem: Problem) -> Input:
    """Return the record of everything that determines the findings."""
    split, config = problem.split, problem.config
    sizes = {
        equation: sum(term.equation == equation for term in problem.library)
        for equation in problem.system.fields
    }
    splits = Splits(
        inputs=list(split.inputs),
        extra=list(split.extra),
        validate=list(split.validate),
        test=list(split.test),
        time_end=split.time_end,
        note=f"{split.note} Clock: {problem.clock}",
    )
    if problem.others:
        splits["episodes"] = _episodes(problem)
    source = Input(
        config=json.loads(json.dumps(frozen_input(config))),
        config_sha256=config_sha256(config),
        recording_sha256=problem.recording_sha256,
        seed=config.seed,
        versions=versions(),
        library_size=sizes,
        splits=splits,
    )
    if problem.left_out:
        source["library_left_out"] = {
            f"{term.equation}: {term}": why if isinstance(why, str) else f"is {why} times a number"
            for term, why in problem.left_out.items()
        }
    return source


def _episodes(problem: Problem) -> list[EpisodeSplit]:
    """Return the fitted and held-out times of every episode."""
    every = [*((p, False) for p in problem.episodes), *((p, True) for p in problem.whole)]
    return [
        EpisodeSplit(
            name=episode.name,
            begin=float(episode.times[0]),
            end=float(episode.times[-1]),
            time_end=episode.split.time_end,
            held_out_whole=held_out,
        )
        for episode, held_out in every
    ]
