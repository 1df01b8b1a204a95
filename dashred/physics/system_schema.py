"""The keys of ``system``: a simulator, declared by its equations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from dashred.core.limits import Limit, NonNegative, Positive, Time, Unit


@dataclass
class Axis:
    """One spatial axis, divided evenly; two at most, none for an ODE."""

    length: Annotated[Positive, Unit("the system's space")]
    """Its length."""

    points: Annotated[int, Limit(at_least=8, at_most=1_000_000)]
    """Number of grid steps: a periodic axis has as many points, one with ends one more."""

    ends: Literal["periodic", "insulated", "fixed"] = "periodic"
    """What holds at both ends: insulated (no slope) or fixed (every field zero)."""


@dataclass
class Integrator:
    """How the system is stepped in time and differentiated in space."""

    method: str | None
    """Name of the time stepper; null takes the first that fits. In space ``etdrk4`` where it is
    spectral, ``ssprk3`` for finite differences; of an ODE ``rk4``, or ``midpoint`` or ``euler``, or
    ``dopri5``, ``dopri8`` or ``bosh3``, which choose their own steps: with these three a run takes
    many times as long."""

    dt: Time | None
    """Largest time step. Must be given, except with snapshots; adaptive methods choose their own
    steps all the same."""

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
    """Nominal initial state of every field: a number or an expression in the coordinates. Must be
    given, except with snapshots."""

    spin_up: Annotated[NonNegative, Unit("the system's time")] = 0.0
    """Time that the simulator runs before the start, so that it starts on its own attractor."""

    spin_up_dt: Time | None = None
    """Time step of the spin-up, which has to find the attractor and no more; null keeps
    integrator.dt."""

    spread: dict[str, Any] = field(default_factory=dict)
    """Prior standard deviation of the initial state: per field a number or a share such as 10%
    of its rms, smooth over a correlation ``length``; or one smooth random g moving several fields,
    as ``kind: gaussian-process`` with ``length``, number of ``modes``, and ``apply``: each moved
    field's expression in g. A field without one is taken to start exactly as given."""

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
