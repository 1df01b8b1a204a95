"""Every key that a configuration may hold: meaning, unit and limits. Defaults: conf/base.yaml.

Times are in the system's own unit, unless a key says otherwise. Wherever a number is asked for,
arithmetic such as ``2*pi`` or ``0.1/15`` may be written instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from dashred.config.limits import Count, Limit, NonNegative, Positive, Time, Unit


@dataclass
class Axis:
    """One spatial axis, divided evenly."""

    length: Annotated[Positive, Unit("the system's space")]
    """Its length."""

    points: Annotated[int, Limit(at_least=8, at_most=1_000_000)]
    """Number of grid points."""

    ends: Literal["periodic", "insulated", "fixed"] = "periodic"
    """What holds at both ends: insulated (no slope) or fixed (every field zero)."""


@dataclass
class Integrator:
    """How the system is stepped in time and differentiated in space."""

    method: str | None
    """Name of the time stepper; null lets the system choose (ETDRK4 where it can)."""

    dt: Time | None
    """Largest time step; adaptive methods of ODEs choose their own and do without it, as do
    snapshots."""

    dealias: bool
    """Whether products are dealiased by the 2/3 rule."""

    space: Literal["spectral", "finite-difference"]
    """How spatial derivatives are taken."""

    rtol: Annotated[float, Limit(above=0, below=1)]
    """Relative tolerance of adaptive methods."""

    atol: Annotated[Positive, Unit("the fields' own")]
    """Absolute tolerance of adaptive methods."""


@dataclass(kw_only=True)
class Structure:
    """A port-Hamiltonian form of the equations: ``(J - R)*dH/dx + G*u``; zeros may be left out."""

    H: str
    """The energy; with axes its density, in which grad2 and derivatives may stand."""

    J: dict[str, dict[str, str]]
    """Where energy goes, skew: by equation, then field."""

    R: dict[str, dict[str, str]] = field(default_factory=dict)
    """What takes energy away, symmetric and positive semi-definite: by equation, then field."""

    G: dict[str, dict[str, str]] = field(default_factory=dict)
    """Ports: by equation, then input."""


@dataclass(kw_only=True)
class System:
    """A simulator, declared by its equations. Texts are in the equation language."""

    title: str
    """What a reader calls the system."""

    axes: dict[str, Axis] = field(default_factory=dict)
    """Spatial axes by name, two at most; none for an ODE."""

    fields: dict[str, str]
    """The state: name of each field, and what it means. Its unit may stand behind that, in square
    brackets: ``theta: angle from hanging [rad]``; inside { } such a text needs quotes."""

    parameters: dict[str, float] = field(default_factory=dict)
    """Constants of the equations, by name."""

    let: dict[str, str] = field(default_factory=dict)
    """Abbreviations: name, and the expression it stands for."""

    equations: dict[str, str] = field(default_factory=dict)
    """Right-hand side of d(field)/dt, for every field."""

    snapshots: str | None = None
    """Instead of equations: runs of a simulator that nothing else is known of, as a NetCDF file
    (``.nc``) or a Zarr folder, one variable a field, over ``(member, time, *axes)``."""

    class_: str | None = None
    """Instead of equations: ``MODULE.CLASS`` of a simulator in Python, whose code runs only if the
    command line says ``trust=MODULE.CLASS``."""

    start: dict[str, Any] = field(default_factory=dict)
    """Nominal initial state of every field: a number or an expression in the coordinates."""

    spin_up: Annotated[NonNegative, Unit("the system's time")] = 0.0
    """Time that the simulator runs before the start, so that it starts on its own attractor."""

    spin_up_dt: Time | None = None
    """Time step of the spin-up, which has to find the attractor and no more; null keeps
    integrator.dt."""

    spread: dict[str, Any] = field(default_factory=dict)
    """Prior standard deviation of the initial state: per field a number or a share such as 10%
    of its rms, smooth over a correlation ``length``; or one smooth random g moving several fields,
    as ``kind: gaussian-process`` with ``length``, number of ``modes``, and ``apply``: each moved
    field's expression in g."""

    energy: str | None = None
    """What the report calls the system's energy, over fields, parameters and lets: it tells how
    much of it the corrected system loses per cycle. Null tells nothing."""

    structure: Structure | None = None
    """Its port-Hamiltonian form, against which the equations are held; null claims none."""

    front: str | None = None
    """A field whose front runs around a ring: the report follows its place and its width."""

    inputs: dict[str, str] = field(default_factory=dict)
    """Measured inputs: name in the equations, and the recording's column that holds it."""

    units: dict[str, str] = field(default_factory=dict)
    """Unit of each name that has one: of fields, axes, parameters, lets, inputs, and of time as t.
    Words and figures show them; a recording that states others is refused. Nothing is converted."""

    integrator: Integrator
    """Stepping in time, derivatives in space."""


@dataclass(kw_only=True)
class Recording:
    """The sensor data: a twin's, or the user's own. The higher layer's choice of the two wins."""

    twin: str | None = None
    """Name of the twin experiment whose hidden truth is recorded; ``null`` is a twin too."""

    path: str | None = None
    """The user's own recording, CSV or NetCDF."""

    sensors: Any
    """Number of fit sensors of a twin; or the path of a sensors table of a CSV recording."""

    noise: Annotated[NonNegative, Unit("each field's standard deviation")]
    """Of twins: standard deviation of the noise."""

    duration: Time
    """Of twins: how long the recording lasts."""

    every: Time | None
    """Step between samples: twins are sampled so, finer recordings decimated to it; null keeps
    the recording's own step."""

    reads: list[str]
    """Of twins: the fields or lets that the sensors read; empty means every field."""

    drive: dict[str, str] = field(default_factory=dict)
    """Of twins: what drives each input, by its column, as an expression of t."""


@dataclass
class SensorSplit:
    """Which sensors the analysis must not fit. A number draws that many by the seed."""

    validate: Any
    """Sensors for early stopping and for choosing: a number, or a list of names."""

    test: Any
    """Sensors that prove the improvement and are never looked at before: number or names."""

    extra: Annotated[int, Limit(at_least=0)] | None
    """Fit sensors used in assimilation but not as SHRED's input; null takes a third of the fit
    sensors when there are at least 6, else none."""


@dataclass
class TimeSplit:
    """Which part of the record is held out."""

    test: Annotated[float, Limit(above=0, below=0.9), Unit("the record")]
    """Its last part, for testing only."""


@dataclass
class Splits:
    """What is held out, in space and in time."""

    sensors: SensorSplit
    time: TimeSplit


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
    """Candidate terms of each equation; null builds them from the fields alone."""

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
    """``cpu``, ``cuda`` or ``cuda:1``."""

    output: str | None
    """Folder of the findings; null uses the MLflow run's artifact folder."""

    tracking: Tracking
