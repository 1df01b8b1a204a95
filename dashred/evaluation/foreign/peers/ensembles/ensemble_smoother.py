"""The ensemble smoother with multiple data assimilation of the package iterative-ensemble-smoother.

The unknowns are the start and the coefficients of all terms; a run over the whole window predicts
the readings. Emerick & Reynolds, *Ensemble smoother with multiple data assimilation* (Computers &
Geosciences 55, 2013). Number of assimilations and truncation are the defaults of the package.
"""

from __future__ import annotations

import numpy as np

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.optional import import_optional
from dashred.evaluation.foreign.peers.ensembles.ensemble import Ensemble, Estimate, law_of
from dashred.evaluation.foreign.peers.measured import Measured, NoAnswerError

MEMBERS, LEAST_MEMBERS = 200, 50


def smooth_ensemble(given: Measured) -> list[TermEntry]:
    """Return the law of the last ensemble.

    Raises:
        InputError: the package is not installed.
        NoAnswerError: too few members are left, or they do not fit the readings.
    """
    return law_of(given, _smooth)


def _smooth(given: Measured, ensemble: Ensemble) -> Estimate:
    """Return the coefficients of the last ensemble; a member that blows up is left out."""
    package = import_optional("iterative_ensemble_smoother")
    rng = np.random.default_rng([given.seed, *b"smoother"])
    members = ensemble.draw(MEMBERS, rng)
    variances = np.tile(given.noise**2, len(given.times))
    smoother = package.ESMDA(variances, given.readings.ravel(), seed=rng)
    for _ in range(smoother.num_assimilations()):
        states = ensemble.run(members, given.times)
        kept = np.flatnonzero(np.isfinite(states).all(axis=(1, 2)))
        if len(kept) < LEAST_MEMBERS:
            raise NoAnswerError(f"only {len(kept)} of {MEMBERS} members do not blow up")
        predicted = states[kept][:, :, given.columns].reshape(len(kept), -1)
        smoother.prepare_assimilation(Y=predicted.T.copy())
        members = smoother.assimilate_batch(X=members[kept].T.copy()).T
    [fitted] = ensemble.run(members.mean(axis=0, keepdims=True), given.times)
    misfits = (fitted[:, given.columns] - given.readings) / given.noise
    coefficients = members[:, ensemble.fields :]
    return Estimate(coefficients.mean(axis=0), coefficients.std(axis=0), float(np.mean(misfits**2)))
