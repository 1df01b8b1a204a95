"""Choose the law of a few terms whose forecast is about as good as the best.

A law of many terms usually makes up for something that no term of the library expresses. Each term
lowers the misfit, but few of them matter. The forecast of the last part of the fitted record, from
a fit to the rest, tells which (docs/method.md#the-law-in-the-headline). No held-out data are used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

# The evidence alone decides up to this number of terms. A larger law is reduced to so many.
MOST_TERMS = 4
# Share of the fitted record to which the laws are fitted; the rest is forecast.
FITTED_SHARE = 0.75
# A forecast is about as good as the best within this share of its error, or one standard error.
MARGIN = 0.05
# A law of many terms stands if it leaves at most this share of the squared error that the forecast
# without a law has beyond the noise, and every law of a few terms leaves at least the other share.
LEFT_BY_MANY, LEFT_BY_FEW = 0.1, 0.5
# Blocks of the forecast whose scatter gives the standard error: errors are correlated in time.
BLOCKS = 10


@dataclass(frozen=True)
class Forecast:
    """Error of a forecast.

    Attributes:
        rmse: root mean square of the errors, in σ.
        std: its standard error.
    """

    rmse: float
    std: float


def forecast_of(errors: Tensor) -> Forecast:
    """Return the size of the errors of a forecast; infinite if it blows up or has no samples.

    Args:
        errors: whitened, ``(time, sensor)``; NaN where missing.
    """
    if bool(torch.isinf(errors).any()):
        return Forecast(math.inf, 0.0)
    blocks = [block.square().nanmean() for block in errors.tensor_split(BLOCKS) if len(block)]
    known = [mean for mean in blocks if not mean.isnan()]
    if not known:
        return Forecast(math.inf, 0.0)
    means = torch.stack(known)
    rmse = float(means.mean().sqrt())
    spread = float(means.std() / math.sqrt(len(means))) if len(means) > 1 else 0.0
    return Forecast(rmse, spread / (2 * rmse) if rmse else 0.0)


def smallest_sufficient(forecasts: Sequence[Forecast]) -> int:
    """Return the index of the first forecast that is about as good as the best.

    Args:
        forecasts: of laws in order of their number of terms.
    """
    best = min(forecasts, key=lambda forecast: forecast.rmse)
    limit = max((1 + MARGIN) * best.rmse, best.rmse + best.std)
    return next(i for i, forecast in enumerate(forecasts) if forecast.rmse <= limit)


def needs_many_terms(without: Forecast, few: Sequence[Forecast], many: Forecast) -> bool:
    """Return whether a law of many terms forecasts the record, and no law of a few terms does.

    Args:
        without: forecast of the simulator without a law.
        few: forecasts of laws of a few terms.
        many: forecast of the law of many terms.
    """
    error = _beyond_noise(without)
    if not 0 < error < math.inf or _beyond_noise(many) > LEFT_BY_MANY * error:
        return False
    return all(_beyond_noise(each) >= LEFT_BY_FEW * error for each in few)


def _beyond_noise(found: Forecast) -> float:
    return max(found.rmse**2 - 1, 0.0)
