"""The schema of the quality of a fit: its residuals, and the errors on held-out data.

A quantity that was not determined is null. Errors are RMSEs in units of a standard deviation.
"""

from typing import Literal, NotRequired, TypedDict, cast

from dashred.core.findings.methods import AT_SENSORS, with_deprecated


class ErrorsByMethod(TypedDict):
    """RMSE of each method at sensors, in units of each sensor's standard deviation.

    The names are those of :mod:`dashred.core.findings.methods`. `nearest_snapshots` and
    `shred_plain` exist only for a simulator that is given as snapshots.

    `before`, `before_refit`, `after` and `snapshots` are deprecated: they repeat
    `simulation_same_start`, `simulation_refit`, `corrected` and `nearest_snapshots` for one
    release.
    """

    simulation: float | None
    simulation_same_start: float | None
    simulation_refit: float | None
    shred: float | None
    dashred: float | None
    corrected: float | None
    nearest_snapshots: NotRequired[float]
    shred_plain: NotRequired[float]
    before: float | None
    before_refit: float | None
    after: float | None
    snapshots: NotRequired[float]


class HeldOut(TypedDict):
    """RMSE on data that no fit used.

    `heldout_restarted` is the held-out time simulated from a state that was fitted to the last
    samples before it. `heldout_episode` is an episode that was held out completely, simulated from
    an initial state that was fitted to its beginning; the key exists only with such an episode.
    """

    test_sensors: ErrorsByMethod
    heldout_time: ErrorsByMethod
    heldout_restarted: ErrorsByMethod
    heldout_episode: NotRequired[ErrorsByMethod]


HeldOutData = Literal["test_sensors", "heldout_time", "heldout_restarted", "heldout_episode"]


class Comparison(TypedDict):
    """Comparison of `corrected` with `simulation_refit` on one kind of held-out data.

    `before` and `after` are the RMSEs without and with the law, with the sensors corrected for
    both. `difference` is the mean of ``e_after² − e_before²``, and `error` the half width of its
    99 % interval, or null if there are too few samples. `samples` is the number of times. The runs
    of a chaotic system are compared until both are lost: `horizon` is the time from their beginning
    to then. It is null if they are compared to their end. `worse` tells whether the law increases
    the error by more than `error`, or makes a run blow up.
    """

    data: HeldOutData
    before: float
    after: float
    difference: float
    error: float | None
    samples: int
    horizon: float | None
    worse: bool


FaultContradiction = Literal["no-better-than-mean", "other-sensors"]
"""How held-out data contradict that only sensors err.

The simulation predicts no held-out data better than their mean does, or it disagrees with sensors
that no fit has used.
"""

Doubt = Literal["worse", "few-readings"] | FaultContradiction
"""Why an explanation is not confirmed.

With the law the error on some held-out data is larger, or the readings are too few to prove it; or
held-out data contradict that only sensors err.
"""

LARGEST_OWN_ERROR = 1e6
"""From this numerical error on, one of the two simulations that are compared is not finite."""


class Fit(HeldOut):
    """Quality of the fit to the recording.

    `noise_std` is the noise of each sensor, in its unit, as stated or estimated from its trace.
    `residual_std` is that of the residuals of the fit. It is much larger if no law explains the
    recording. `chi2` is the misfit of the law per sample, relative to `residual_std`, and
    `unexplained` the share of the squared residuals that is not noise.
    `readings` is the number of readings in the fit, and `start_values` that of the start values of
    an ODE system that they determine beside the law.
    `held_out_samples` are the numbers of times with held-out readings, over all episodes.
    `noise_correlation` is the largest correlation of neighbouring samples over all quantities.
    `own_error` is the numerical error of the simulator at the start of the recording, in units of
    `residual_std`, at most 1e6; null if the law diverges or is not told. If it exceeds 1,
    `sufficient_dt` is a time step with which it is at most 0.1, if there is one, and else null. If
    the simulator is a program, `failure` says how many of its steps failed, and what it said when
    one last did.
    `corrected_dt` is the time step of the corrected simulator if that of the simulator is unstable
    with the law, and else null. `diverges` is the time, in the recording or in the forecast after
    it, at which the corrected simulator leaves all bounds, with shorter time steps as well; null if
    it does not, or if it is a program.
    `comparisons` tell whether held-out data support the law.
    `misfit_at_test_sensors` is the RMSE of the corrected simulator at each test sensor, in
    standard deviations of the residuals at the fitted sensors.
    `outside_basis` is the RMS of what SHRED's modes cannot express of the corrected field, in
    standard deviations of each field: no estimate of SHRED can err less. It is null if nothing
    varies.

    `unconfirmed` tells why the explanation is not confirmed; null unless this is the verdict.
    """

    comparisons: list[Comparison]
    noise_std: dict[str, float] | None
    residual_std: NotRequired[dict[str, float]]
    readings: NotRequired[int]
    start_values: NotRequired[int]
    held_out_samples: NotRequired[dict[HeldOutData, int]]
    noise_correlation: float | None
    own_error: float | None
    failure: NotRequired[str | None]
    sufficient_dt: NotRequired[float | None]
    corrected_dt: NotRequired[float | None]
    diverges: NotRequired[float | None]
    chi2: float | None
    unexplained: float | None
    misfit_at_test_sensors: dict[str, float] | None
    outside_basis: NotRequired[float | None]
    unconfirmed: NotRequired[Doubt | None]


def errors_by_method(**rmse: float) -> ErrorsByMethod:
    """Return the errors of the given methods; other errors are null.

    Raises:
        TypeError: a name is not in ``AT_SENSORS``.
    """
    if unknown := rmse.keys() - set(AT_SENSORS):
        raise TypeError(f"the findings have no method called {', '.join(sorted(unknown))}")
    always = [name for name in AT_SENSORS if name in ErrorsByMethod.__required_keys__]
    result = with_deprecated(dict.fromkeys(always) | rmse)
    return cast(ErrorsByMethod, result)
