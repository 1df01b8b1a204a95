"""Estimate the run time of an analysis."""

from __future__ import annotations

import math

from dashred.config import Config
from dashred.models.network_size import network_size
from dashred.pipeline.check.context import CheckContext
from dashred.pipeline.check.remark import Remark
from dashred.pipeline.check.simulator_checks.observability import Observability
from dashred.pipeline.check.simulator_checks.simulator import NominalRun
from dashred.pipeline.time_shares import ENDS, budget_seconds

# Seconds of overhead per run: imports, figures, MLflow.
OVERHEAD = 12.0
# Seconds of one training step with 48 windows of 24 samples at 64 latents.
TRAINING_STEP = 0.006
# Time of assimilation and latent SINDy over the time of training, measured in runs from snapshots
# of rde and ks2d.
ASSIMILATION = 0.9
# Time of a trajectory in a batch over its time alone.
BATCHED = 0.3
# Seconds of discovery over the square root of the seconds of one linearisation in all columns, for
# a clear case and for one with many possible causes. Fitted to measured runs on 2 cores (fhn, ks1d,
# rde, the real pendulum).
CLEAR, HARD = 20.0, 180.0


def run_time_remark(
    context: CheckContext, nominal: NominalRun, observed: Observability | None
) -> Remark:
    """Return the range from a clear case to one whose causes are hard to tell apart.

    A run is refused if its first simulation alone would take longer than all of them may.
    """
    config, samples = context.config, len(context.times)
    limit = budget_seconds(config)
    alone, allowed = samples * nominal.sample_seconds, ENDS["simulate"] * limit
    # A program that takes too long is run over segments only.
    if context.system.program is None and alone > allowed:
        return Remark(
            f"A simulation of the record takes about {_rounded_duration(alone)}, and the first "
            f"simulations of a run may take {_rounded_duration(allowed)} of its {limit:g} s",
            "error",
            "give more time (budget=SECONDS), state a longer system.integrator.dt if it resolves "
            "the record, take a coarser grid, or a part of the recording (recording.end)",
        )
    training = 1.5 * _training(config)
    members = config.simulation.members + config.surrogate.members
    ensembles = BATCHED * members * samples * nominal.sample_seconds
    column = nominal.sample_seconds if observed is None else observed.seconds
    columns = (0 if observed is None else observed.prior_size) + len(context.library)
    linearisation = column * samples * columns
    fixed = OVERHEAD + training + ensembles
    least, most = (min(limit, fixed + share * math.sqrt(linearisation)) for share in (CLEAR, HARD))
    return Remark(
        f"About {_rounded_duration(least)} if one cause stands out, about "
        f"{_rounded_duration(most)} if many have to be compared; longer on a busy machine"
    )


def snapshots_run_time_remark(config: Config) -> Remark:
    """Return the run time from snapshots: training, assimilation and figures, without discovery."""
    seconds = OVERHEAD + (1.0 + ASSIMILATION) * _training(config)
    return Remark(f"About {_rounded_duration(seconds)}; longer on a busy machine")


def _training(config: Config) -> float:
    """Return the seconds of training SHRED."""
    shred, system = config.shred, config.system
    values = len(system.fields) * math.prod(axis.points for axis in system.axes.values())
    size = network_size(values, shred.latent, shred.decoder, shred.epochs)
    share = (shred.lags + 1) / 25 * shred.batch / 48 * size.latent / 64
    return TRAINING_STEP * size.epochs * shred.steps * share


def _rounded_duration(seconds: float) -> str:
    if seconds < 55:
        return f"{max(10, round(seconds, -1)):.0f} s"
    minutes = seconds / 60
    return f"{round(minutes)} min" if minutes < 90 else f"{minutes / 60:.1f} h"
