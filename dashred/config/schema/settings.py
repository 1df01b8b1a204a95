"""All keys of a configuration with meaning, unit and limits. Defaults are in conf/base.yaml.

The keys of the system and of the recording are in separate files. Times are in the system's unit
of time, unless a key states another. A number may be written as arithmetic, such as ``2*pi`` or
``0.1/15``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from dashred.config.schema.recording import Recording, Splits
from dashred.core.limits import Count, Limit, NonNegative, Positive, Time, Unit
from dashred.physics.system_schema import System


@dataclass
class Simulation:
    """The ensemble of simulations on which SHRED is trained."""

    members: Annotated[int, Limit(at_least=2, at_most=1_000_000)]
    """Total number of trajectories."""

    held_out: Count
    """Number of trajectories that are not trained on but measure the reconstruction."""

    discrepancy: bool
    """Whether each member has a random draw of library terms added to its equations."""

    terms: Count
    """Number of library terms in each draw. If the library has fewer, all are drawn."""

    amplitude: Annotated[NonNegative, Unit("the equation's tendency")]
    """Size of the tendency of a drawn term."""

    dt: Time | None
    """Time step of the ensemble, which may be less accurate than that of the findings; null chooses
    the longest of 1, 2, 4 and 8 times system.integrator.dt that changes readings by less than 1 %
    of their std."""

    memory: str | None
    """Memory that a run may take to simulate the ensemble and to train on it, such as ``4 GiB``. An
    ensemble that would take more is written to disk and read in parts. Null takes half of the
    machine's memory."""


@dataclass
class Shred:
    """The network from sensor histories to the field: an LSTM and a shallow decoder."""

    lags: Annotated[Count, Unit("samples")]
    """Length of the history before the present sample."""

    latent: Count | None
    """Size of the latent state h; null chooses it by the size of the state: 32 for up to 1024
    values, else 64."""

    layers: Count
    """Number of layers of the LSTM."""

    decoder: list[Count] | None
    """Widths of the decoder's hidden layers; null chooses them by the size of the state: [64, 64]
    for up to 16 values, [128] for up to 1024, else [256, 256]."""

    modes: Count
    """Number of POD modes of the decoder's output."""

    epochs: Count | None
    """Maximum number of epochs; null chooses it by the size of the state: 14 for up to 16 values,
    else 20."""

    steps: Count
    """Optimiser steps per epoch."""

    patience: Count
    """Epochs without improvement on held-out members before training stops."""

    batch: Count
    """Sequences of lags + 1 samples per optimiser step."""

    rate: Positive
    """Peak learning rate."""


@dataclass
class Assimilation:
    """The latent transform fitted to the real sensors, with the decoder frozen."""

    epochs: Count
    """Maximum number of passes over the recording's windows."""

    patience: Count
    """Epochs without improvement on the validation sensors before fitting stops."""

    batch: Count
    """Windows per optimiser step."""

    rate: Positive
    """Learning rate of the transform."""

    encoder_rate: NonNegative
    """Learning rate of SHRED's LSTM; 0 freezes it."""

    penalty: NonNegative
    """Weight λ of the transform's squared size in the loss."""

    width: Count
    """Width of the transform's hidden layer; with dynamics it is at least 256."""

    gain: Annotated[float, Limit(at_least=0, below=1), Unit("the error before")]
    """Relative reduction of the validation error below which the transform is discarded; with
    dynamics any reduction counts."""

    dynamics: bool
    """Also fit the steps of the simulator between samples, with the law as an unknown."""

    adapter: bool
    """With dynamics: fit an adapter beside the frozen decoder, too."""

    residual: Literal["fields", "alg1", "alg2"]
    """With dynamics: what the errors of the steps are measured in. alg1 and alg2 are the residuals
    of Algorithms 1 and 2 in the latent space; the networks alone are fitted then, and the terms of
    the law are those that the algorithm proposes at the end of each epoch."""


@dataclass
class LatentSindy:
    """Algorithms 1 and 2: sparse regression for missing terms in the latent space."""

    steps: list[Annotated[Count, Unit("samples")]]
    """Lengths of the increments in the regression."""

    threshold: NonNegative
    """STLSQ threshold: smaller scaled coefficients are set to zero."""

    bootstraps: Count
    """Number of block-bootstrap draws for each inclusion frequency."""

    begins: Count
    """Number of increments, with start times spread over the fit window."""

    every: Count
    """Epochs of assimilation between two regressions."""


@dataclass
class Discovery:
    """The joint fit of the law and the initial state to the sensors, through the simulator."""

    walking: Count
    """Number of candidates in the fit while the horizon grows: those with the most distinct
    effects."""

    tight: Annotated[Positive, Unit("the equation's tendency")]
    """Prior std of a coefficient while the horizon grows, in terms of the tendency of its term."""

    weak: Annotated[Positive, Unit("the equation's tendency")]
    """Prior std for selection and the last fit; values below 0.3 shrink true coefficients."""


@dataclass
class Surrogate:
    """SHRED retrained on the corrected simulator."""

    members: Annotated[int, Limit(at_least=2, at_most=1_000_000)]
    """Total number of trajectories, of which simulation.held_out are not trained on."""

    spread: Annotated[Positive, Unit("the start prior's spread")]
    """Spread of the initial states around the fitted initial state."""


@dataclass
class Trainer:
    """Where and how Lightning trains the networks. The law is fitted in float64 in any case."""

    accelerator: Literal["cpu", "gpu"] | None
    """Kind of device of the networks; null takes the one of the key device."""

    devices: Count | None
    """Number of processes that share each batch, one for each GPU or CPU; null trains on one device
    in the process of the analysis."""

    strategy: str | None
    """Strategy of Lightning; null takes ``ddp_spawn`` for several devices. The others start the
    whole analysis once for each device, or copy it while it runs."""

    precision: Literal["32-true", "bf16-mixed", "16-mixed"] | None
    """Precision in which SHRED is trained on simulations; null takes 32-true. The assimilation is
    trained in float32."""


@dataclass
class Tracking:
    """The MLflow store of the run."""

    root: str
    """Folder of the MLflow store and its artifacts, or the address of an MLflow tracking server,
    http://HOST:PORT, or of a PostgreSQL database, postgresql://USER@HOST/DATABASE."""

    artifacts: str | None
    """Bucket, or folder in it, that holds the artifacts: s3://BUCKET/FOLDER. A database needs one;
    for another ``tracking.root`` it is null."""

    experiment: str | None
    """Name of the MLflow experiment; null takes the name of the configuration."""

    run: str | None
    """Id of an existing parent run; null opens a new one."""

    parent: str | None
    """Id of the run below which a new run is nested; null does not nest it."""

    model: bool
    """Whether the corrected surrogate is logged as an MLflow model, which takes some seconds."""


@dataclass
class Settings:
    """All keys of a configuration."""

    system: System
    library: dict[str, list[str]] | None
    """Candidate terms of each equation or let. One that is not listed has none. Null builds them
    from the fields and inputs, except for equations that only define another field
    (``theta: omega``, ``q: p/m`` with a p that depends on q). Sines and cosines are then candidates
    for angles only: fields whose sine or cosine an equation contains, whose unit is ``rad`` or
    ``deg``, whose description says angle, or that ``recording.angles`` names."""

    recording: Recording
    splits: Splits
    simulation: Simulation
    shred: Shred
    assimilation: Assimilation
    latent_sindy: LatentSindy
    discovery: Discovery
    surrogate: Surrogate
    trainer: Trainer

    budget: Annotated[Positive, Unit("seconds")] | None
    """Time that an analysis may take, to within 10 %. What does not fit into it is left out and
    listed in the findings. It begins when all code is loaded; the first run of an installation
    compiles code for some seconds before. Null gives 600 s to a system with two axes, else 300 s.
    """

    resolution_limit: Annotated[Positive, Unit("a trace's standard deviation")]
    """Largest change of a sensor trace when the resolution is doubled."""

    seed: Annotated[int, Limit(at_least=0, below=2**32)]
    """Seed of all random numbers in the analysis."""

    threads: Count
    """Number of CPU threads for trajectories. torch uses one thread, because its arrays are small
    and more threads would wait for each other on a busy machine."""

    cluster: str | None
    """Dask workers that compute parts of an analysis: the calls of ``system.simulator.command``, or
    the ensemble and the Jacobians of large spectral fields. ``local`` (a process for each core), a
    number of processes, the address of a scheduler (``tcp://HOST:PORT``), ``slurm:N`` or
    ``kubernetes:N``. Null computes in threads of this machine."""

    device: str
    """Device for the networks, and for trajectories of spectral fields and their derivatives:
    ``cpu``, ``cuda`` or ``cuda:1``. All else is computed on the CPU."""

    output: str | None
    """Folder of the findings; null uses the artifact folder of the MLflow run."""

    tracking: Tracking
