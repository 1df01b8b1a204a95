"""The iterative ensemble Kalman smoother of the package DAPPER, state and coefficients together.

Bocquet & Sakov, *Joint state and parameter estimation with an iterative ensemble Kalman smoother*
(Nonlin. Processes Geophys. 20, 2013). The state is augmented with the coefficients, which stay
constant; the settings are those of the package's example of parameters, with more members than
unknowns: the finite-size form, which needs no inflation, and windows of four samples. What it knows
at a time comes from the readings up to that time.
"""

from __future__ import annotations

import contextlib
import os

import numpy as np

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.optional import import_optional
from dashred.evaluation.foreign.peers.ensembles.ensemble import Ensemble, Estimate, law_of
from dashred.evaluation.foreign.peers.measured import Measured, NoAnswerError

WINDOW, FINITE_SIZE, TOLERANCE = 4, 2.0, 1e-5
# Members beside one for each unknown.
SPARE_MEMBERS = 20


def smooth_iteratively(given: Measured) -> list[TermEntry]:
    """Return the law after the last reading.

    Raises:
        InputError: the package is not installed.
        NoAnswerError: the ensemble has diverged, or does not follow the readings.
    """
    return law_of(given, _smooth)


def _smooth(given: Measured, ensemble: Ensemble) -> Estimate:
    """Return the coefficients after the last reading."""
    methods = import_optional("dapper.da_methods")
    package, models = import_optional("dapper"), import_optional("dapper.mods")
    package.set_seed(given.seed % 2**32)
    unknowns, span = len(ensemble.mean), float(given.times[1] - given.times[0])
    observed = np.eye(unknowns)[given.columns]

    def advance(members: Array, time: float, duration: float) -> Array:
        after = ensemble.advance(np.atleast_2d(members), given.times[0] + time, duration)
        if not np.isfinite(after).all():
            raise NoAnswerError("members of the ensemble blow up")
        return after.reshape(np.shape(members))

    model = models.HiddenMarkovModel(
        models.Operator(M=unknowns, model=advance, noise=0),
        {
            "M": len(given.columns),
            "model": lambda members: members @ observed.T,
            "noise": given.noise**2,
        },
        models.Chronology(dt=span, dko=1, Ko=len(given.times) - 2, Tplot=span, BurnIn=0),
        models.GaussRV(mu=ensemble.mean, C=ensemble.std**2),
    )
    smoother = methods.iEnKS(
        "Sqrt", unknowns + SPARE_MEMBERS, Lag=WINDOW, xN=FINITE_SIZE, wtol=TOLERANCE
    )
    # The package compares with a truth, which it is not given.
    nothing = np.zeros((len(given.times), unknowns))
    with open(os.devnull, "w") as silent, contextlib.redirect_stdout(silent):
        smoother.assimilate(model, nothing, given.readings[1:], liveplots=False)
    mean, std = np.asarray(smoother.stats.mu.a), np.asarray(smoother.stats.spread.a)
    misfits = (mean[:, given.columns] - given.readings[1:]) / given.noise
    unknown = slice(ensemble.fields, None)
    return Estimate(mean[-1, unknown], std[-1, unknown], float(np.mean(misfits**2)))
