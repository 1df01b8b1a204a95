"""Assimilation with dynamics, by the networks first and by the states of all samples then."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.models.dynamics.distillation import distil
from dashred.models.dynamics.network_assimilation import NetworkAssimilation
from dashred.models.dynamics.network_fit import LAW_PENALTY
from dashred.models.dynamics.state_fit import Minimum, StateFit
from dashred.models.dynamics.weak_constraint import WeakConstraint


class DynamicAssimilation(NetworkAssimilation):
    """The first epoch fits the networks, and the later ones fit the states of all samples.

    What a network gives varies smoothly with the latent state, which leads past fields that fit the
    readings by chance. The later epochs minimise the same loss over the POD coefficients of all
    samples by Gauss–Newton steps (:mod:`.gauss_newton`), to which the networks are then fitted
    (:mod:`.distillation`). The terms of the law are chosen at the end of an epoch
    (:class:`callbacks.law_selection.LawSelection`). With an adapter, the basis then gets modes for
    what the forecasts have outside of it (:mod:`.moving_basis`). The steps are not asked to fit
    better than the forecasts lie in the basis, or than their numerical error.

    Attributes:
        minimum: of the loss in the last epoch; None after the first one.
    """

    minimum: Minimum | None = None

    @property
    def is_consistent(self) -> bool:
        """Whether noise explains what is left of the readings and of the steps."""
        return self.minimum is None or self.minimum.is_consistent

    def minimise(self, windows: Tensor, latent: Tensor, readings: Tensor) -> dict[str, float]:
        """Fit the networks or, after the first epoch, the states; return the parts of the loss."""
        if self.current_epoch == 0:
            return super().minimise(windows, latent, readings)
        self.minimum = self.loss(readings).fit(self._present(latent), self.error)
        left = self.take(windows, self.minimum)
        return self.minimum.fitted.parts | {"network_error": left}

    def on_train_epoch_end(self) -> None:
        """Let the basis grow; end the fit if neither q nor the terms of the law change any more."""
        self.basis.grow(self.dynamics, self._last, self.error)
        self.log("basis/outside", self.basis.outside)
        self.log("basis/modes", float(len(self.shred.spread)))
        super().on_train_epoch_end()

    def take(self, windows: Tensor, minimum: Minimum) -> float:
        """Take the law and the basis of a minimum, and fit the networks to its states.

        Returns:
            What is left, RMS in std.
        """
        fitted, problem = minimum.fitted, minimum.loss.problem
        self.dynamics.set_law(fitted.coefficients)
        self.basis.resize(problem.pod.modes, problem.spread.float())
        with torch.no_grad():
            latent = self.shred.encode(windows)
        scale = self.shred.spread / self.shred.pod.modes.shape[1] ** 0.5
        decoder, transform = self.basis.adapted or self.shred.decoder, self.encoder.transform
        return distil(transform, decoder, self.fitted, latent, fitted.unknowns.states, scale)

    def loss(self, readings: Tensor) -> StateFit:
        """Return the loss of the states.

        Args:
            readings: of the fit sensors, ``(time, sensor)``, NaN where missing.
        """
        problem = WeakConstraint(
            self.dynamics,
            self.shred.pod,
            self.shred.spread,
            self.sensors.fit,
            self.sensors.noise,
            readings,
            self.basis.guess,
            self.background,
            LAW_PENALTY,
        )
        return StateFit(problem, self.is_over)

    @torch.no_grad()
    def _present(self, latent: Tensor) -> Tensor:
        """Return the states that the networks give, ``(time, mode)``."""
        return self.shred.decoder(self.encoder.transform(latent)).double()
