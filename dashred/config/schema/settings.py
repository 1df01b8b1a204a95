"""Every key that a configuration may hold: meaning, unit and limits. Defaults: conf/base.yaml.

Those of the system and of the recording have files of their own. Times are in the system's own
unit, unless a key says otherwise. Wherever a number is asked for, arithmetic such as ``2*pi`` or
``0.1/15`` may be written instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from dashred.config.schema.recording import Recording, Splits
from dashred.core.limits import Count, Limit, NonNegative, Positive, Time, Unit
from dashred.physics.system_schema import System


@dataclass
class Simulation:
    """The ensemble of simulations that SHRED learns from."""

    members: Annotated[int, Limit(at_least=2, at_most=1_000_000)]
    """Trajectories in all."""

    held_out: Count
    """How many of them measure the reconstruction and are not trained on."""

    discrepancy: bool
    """Whether each member carries a random draw of library terms."""

    terms: Count
    """Library terms in each draw."""

    amplitude: Annotated[NonNegative, Unit("the equation's tendency")]
    """Size of a drawn term's tendency."""

    dt: Time | None
    """Time step of the ensemble, which need not be as exact as the findings; null keeps
    system.integrator.dt."""


@dataclass
class Shred:
    """The network from sensor histories to the field: an LSTM and a shallow decoder."""

    lags: Annotated[Count, Unit("samples")]
    """Length of the history behind the present sample."""

    latent: Count
    """Size of the latent state h."""

    layers: Count
    """Layers of the LSTM."""

    decoder: list[Count]
    """Widths of the decoder's hidden layers."""

    modes: Count
    """POD modes that the decoder's coefficients multiply."""

    epochs: Count
    """Epochs at most."""

    steps: Count
    """Steps of the optimiser in an epoch."""

    patience: Count
    """Epochs without improvement on held-out members before training stops."""

    batch: Count
    """Stretches of lags + 1 samples in each step of the optimiser."""

    rate: Positive
    """Peak learning rate."""


@dataclass
class Assimilation:
    """The latent transform fitted to the real sensors, with the decoder frozen."""

    epochs: Count
    """Passes over the recording's windows, at most."""

    patience: Count
    """Epochs without improvement on the validation sensors before fitting stops."""

    batch: Count
    """Windows in each step of the optimiser."""

    rate: Positive
    """Learning rate of the transform."""

    encoder_rate: NonNegative
    """Learning rate of SHRED's LSTM; 0 freezes it too."""

    penalty: NonNegative
    """Weight λ of the transform's squared size in the loss."""

    width: Count
    """Width of the transform's hidden layer."""

    gain: Annotated[float, Limit(at_least=0, below=1), Unit("the error before")]
    """Share by which the validation error must fall for the transform to be kept at all."""


@dataclass
class LatentSindy:
    """Algorithms 1 and 2: sparse regression for missing terms in the latent space."""

    steps: list[Annotated[Count, Unit("samples")]]
    """Increments of the recording regressed on."""

    threshold: NonNegative
    """STLSQ: scaled coefficients below this are dropped."""

    bootstraps: Count
    """Block-bootstrap draws behind each inclusion frequency."""

    begins: Count
    """Times to step from, spread over the fit window."""

    every: Count
    """Epochs of assimilation between two regressions."""


@dataclass
class Discovery:
    """The law and the start, fitted together through the simulator to the sensors."""

    walking: Count
    """Candidates carried while the horizon grows: those whose effects differ most."""

    tight: Annotated[Positive, Unit("the equation's tendency")]
    """Prior std of a coefficient meanwhile, told by the tendency that it makes."""

    weak: Annotated[Positive, Unit("the equation's tendency")]
    """The same for selection and the last fit; below 0.3 true coefficients are shrunk."""


@dataclass
class Surrogate:
    """SHRED retrained on the corrected simulator."""

    members: Annotated[int, Limit(at_least=2, at_most=1_000_000)]
    """Trajectories in all, simulation.held_out of them not trained on."""

    spread: Annotated[Positive, Unit("the start prior's spread")]
    """How far they start from the fitted start."""


@dataclass
class Tracking:
    """Where MLflow keeps the run."""

    root: str
    """Folder of the MLflow store and of its artifacts; or the URL of an MLflow tracking server,
    http://HOST:PORT, which then gets both."""

    experiment: str | None
    """Name of the MLflow experiment; null names it after the configuration."""

    run: str | None
    """Id of a parent run that is already open; null opens one."""

    parent: str | None
    """Id of a run to nest a newly opened run below; null nests it nowhere."""

    model: bool
    """Whether the corrected surrogate is logged as an MLflow model, which takes some seconds."""


@dataclass
class Settings:
    """The whole tree of keys."""

    system: System
    library: dict[str, list[str]] | None
    """Candidate terms of each equation; one that is not listed gets none. Null builds them from the
    fields and inputs, except for equations that only say what another field is
    (``theta: omega``)."""

    recording: Recording
    splits: Splits
    simulation: Simulation
    shred: Shred
    assimilation: Assimilation
    latent_sindy: LatentSindy
    discovery: Discovery
    surrogate: Surrogate

    resolution_limit: Annotated[Positive, Unit("a trace's standard deviation")]
    """How far doubling the resolution may move a sensor trace."""

    seed: Annotated[int, Limit(at_least=0, below=2**32)]
    """Fixes everything random in the analysis."""

    threads: Count
    """CPU threads that trajectories are shared among. torch itself takes one: its arrays are small,
    and on a busy machine its threads would wait for each other."""

    device: str
    """Where the networks are trained: ``cpu``, ``cuda`` or ``cuda:1``."""

    output: str | None
    """Folder of the findings; null uses the MLflow run's artifact folder."""

    tracking: Tracking
