"""Encoding of fields through their sensor histories, for Algorithms 1 and 2."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.step_sensitivities import RELATIVE_STEP
from dashred.models.lag_windows import windows

Encode = Callable[[Float[Tensor, "batch lag sensor"]], Float[Tensor, "batch latent"]]


class HistoryEncoder:
    """``E(v_t)``: the latent of the history of a reconstructed field, with ``v_t`` as last sample.

    See docs/method.md#latent-sindy.

    Args:
        encode: G or G_R, from windows to the latent state, in float64.
        operator: H of SHRED's input sensors.
        fields: the reconstructed field û, ``(time, field, *grid)``, whose sensor trace is the
            history.
        lags: number of earlier samples in a history.
    """

    def __init__(
        self, encode: Encode, operator: ObservationOperator, fields: Tensor, lags: int
    ) -> None:
        self.encode, self.operator = encode, operator
        self.windows = windows(operator(fields), lags)

    @torch.no_grad()
    def __call__(
        self, times: Float[Tensor, " sample"], fields: Float[Tensor, "sample ..."]
    ) -> Float[Tensor, "sample latent"]:
        """Return E of fields ``(sample, field, *grid)`` at time indices ``times``."""
        return self._encode(times, self.operator(fields))

    @torch.no_grad()
    def linearise(
        self,
        times: Float[Tensor, " sample"],
        fields: Float[Tensor, "sample ..."],
        moves: Float[Tensor, "sample term ..."],
    ) -> tuple[Float[Tensor, "sample latent"], Float[Tensor, "sample term latent"]]:
        """Return E of fields, and how much it changes to first order if the fields change.

        E depends on a field through its readings alone. Its derivative by each reading is computed
        once, and not for every change: there are more terms than sensors.

        Args:
            times: time indices, ``(sample,)``.
            fields: ``(sample, field, *grid)``.
            moves: small changes of the fields, ``(sample, term, field, *grid)``.
        """
        last = self.operator(fields)
        moved = self.operator(fields[:, None] + moves) - last[:, None]
        base = self._encode(times, last)
        std = self.windows[:, -1].std(dim=0)
        steps = torch.diag(RELATIVE_STEP * torch.where(std > 0, std, 1.0))
        changed = [self._encode(times, last + step) - base for step in steps]
        by_reading = torch.stack(changed, dim=-1) / steps.diagonal()
        return base, moved @ by_reading.mT

    def _encode(
        self, times: Float[Tensor, " sample"], last: Float[Tensor, "sample sensor"]
    ) -> Float[Tensor, "sample latent"]:
        """Return the latent of histories up to ``times`` with the last sample replaced."""
        histories = self.windows[times].clone()
        histories[:, -1] = last
        return self.encode(histories)
