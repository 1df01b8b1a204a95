"""How long a run will take, roughly."""

from __future__ import annotations

import math

from dashred.config import Config
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.observability import Seen
from dashred.pipeline.check.remark import Remark
from dashred.pipeline.check.simulator import Simulated

# Seconds that every run takes: imports, figures, MLflow.
ALWAYS = 12.0
# Seconds of one step of training the network, of 48 windows of 24 samples at 64 latents.
TRAINING_STEP = 0.006
# Assimilation into a network takes so many times its training, latent SINDy included (measured runs
# from snapshots of rde and ks2d).
ASSIMILATION = 0.9
# Trajectories cost less in a batch than alone.
BATCHED = 0.3
# Seconds of discovery, by the root of those of one linearisation in all columns: the more there
# are, the fewer are carried at a time. Of a case that is clear, and of one of many causes; they
# are fitted to measured runs on 2 cores (fhn, ks1d, rde, the real pendulum).
CLEAR, HARD = 20.0, 180.0


def about_run_time(situation: CheckContext, simulated: Simulated, seen: Seen | None) -> Remark:
    """Return a range: the least is a clear case, the most one whose causes are hard to tell."""
    config, samples = situation.config, len(situation.times)
    training = 1.5 * _training(config)
    members = config.simulation.members + config.surrogate.members
    ensembles = BATCHED * members * samples * simulated.sample_seconds
    column = simulated.sample_seconds if seen is None else seen.seconds
    columns = (0 if seen is None else seen.of) + len(situation.library)
    linearisation = column * samples * columns
    before = ALWAYS + training + ensembles
    least, most = (before + share * math.sqrt(linearisation) for share in (CLEAR, HARD))
    return Remark(
        f"Roughly {_rough(least)} where one cause stands out, {_rough(most)} where many have to be "
        "weighed; longer on a busy machine"
    )


def about_snapshots_run_time(config: Config) -> Remark:
    """Return how long it takes where no law is sought: to learn, to assimilate, to draw."""
    seconds = ALWAYS + (1.0 + ASSIMILATION) * _training(config)
    return Remark(f"Roughly {_rough(seconds)}; longer on a busy machine")


def _training(config: Config) -> float:
    """Return seconds of SHRED's training."""
    shred = config.shred
    steps = shred.epochs * shred.steps
    return TRAINING_STEP * steps * (shred.lags + 1) / 25 * shred.batch / 48


def _rough(seconds: float) -> str:
    if seconds < 55:
        return f"{max(10, round(seconds, -1)):.0f} s"
    minutes = seconds / 60
    return f"{round(minutes)} min" if minutes < 90 else f"{minutes / 60:.1f} h"
