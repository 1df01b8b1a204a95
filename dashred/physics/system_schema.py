"""The keys of ``system``: a simulator, declared by its equations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from dashred.core.limits import Limit, NonNegative, Positive, Time, Unit


@dataclass
class Axis:
    """One spatial axis with a uniform grid. A system has at most two axes; an ODE has none."""

    length: Annotated[Positive, Unit("the system's space")]
    """Length of the axis."""

    points: Annotated[int, Limit(at_least=8, at_most=1_000_000)]
    """Number of grid steps. A periodic axis has as many points, any other axis one more. With a
    condition for each side it is the number of cells."""

    ends: Any = "periodic"
    """Boundary condition at both ends: periodic, insulated (zero slope) or fixed (every field
    zero). Or a condition for each side of the only axis, ``{left: …, right: …}``. A condition is
    insulated, fixed, outflow, or ``{value: EXPR}``, ``{slope: EXPR}`` or ``{flux: EXPR}`` with an
    expression in t, parameters and inputs. Fields with different conditions are listed by name:
    ``left: {T: {value: T_top}, S: insulated}``."""

    coordinates: Literal["cartesian", "radial"] = "cartesian"
    """Whether the axis is a straight line, or the radius of a cylinder from its centre: there lap
    is ``d(r*d(u, r), r)/r``, and only the right end has a condition."""


@dataclass
class Input:
    """A measured input. A text in place of this section is the column."""

    column: str | None = None
    """Column of the recording; null takes the name of the input."""

    hold: bool = False
    """Whether each sample holds until the next one, as the output of a controller does; else the
    input is a straight line between samples."""

    delay: Annotated[NonNegative, Unit("the system's time")] = 0.0
    """Time after which the input acts. Before the first sample acts, its value holds."""

    delay_spread: Annotated[NonNegative, Unit("the system's time")] = 0.0
    """Standard deviation of a delay that is known only roughly: it is fitted, like a parameter with
    a spread. Not for a system with axes."""


@dataclass
class Table:
    """Points of a function, linear in between and constant outside of them."""

    x: list[float]
    """Where it is known, in increasing order."""

    y: list[float]
    """Its value at each x."""


@dataclass
class Integrator:
    """Integration in time and differentiation in space."""

    method: str | None
    """Time stepper; null takes the default. A system with axes has ``etdrk4`` (spectral, and finite
    volumes for an axis with a condition for each side) or ``ssprk3`` (finite differences). An ODE
    has ``rk4``, ``midpoint``, ``euler``, or the adaptive ``dopri5``, ``dopri8`` and ``bosh3``. An
    analysis has fixed steps of ``rk4`` in place of an adaptive method, short enough for the noise
    of the recording."""

    dt: Time | None
    """Largest time step. Null chooses it from a recording: half of it changes the readings over
    four samples by less than a twentieth of the noise. A twin experiment needs a number. Adaptive
    methods choose their own steps."""

    dealias: bool
    """Whether products are dealiased by the 2/3 rule."""

    space: Literal["spectral", "finite-difference"]
    """Discretisation of spatial derivatives."""

    rtol: Annotated[float, Limit(above=0, below=1)]
    """Relative tolerance of adaptive methods."""

    atol: Annotated[Positive, Unit("the fields' own")]
    """Absolute tolerance of adaptive methods."""


@dataclass
class ExternalSimulator:
    """A simulator that is a program, which runs only if the command line names it: ``trust=NAME``.

    One of function, run, command and fmu is given. Paths are relative to the system's file.
    """

    function: str | None = None
    """``MODULE.FUNCTION`` with the arguments ``(state, t, dt, inputs, parameters)`` that returns
    the state at ``t + dt``. A state is a dictionary of arrays by field."""

    run: str | None = None
    """``MODULE.FUNCTION`` with the arguments ``(start, times, inputs, parameters)`` that returns
    arrays over ``(time, *axes)`` by field, beginning with the start."""

    command: list[str] | None = None
    """Program and arguments of a process that reads states from the file ``{input}`` and writes
    them, a step later, to the file ``{output}``: NetCDF, or text with a template."""

    template: str | None = None
    """Path of a Jinja2 template that writes one state as the text that the command reads. Its
    output is then text too: one line for each grid point, one column for each field."""

    fmu: str | None = None
    """Path of an FMU, of FMI 2 or 3. The fields, parameters and inputs are variables of it."""

    variables: dict[str, str] = field(default_factory=dict)
    """Names of variables of the FMU that differ from those of the system: ``{h: body.h}``."""

    interface: Literal["model-exchange", "co-simulation"] | None = None
    """What is used of an FMU: its derivatives, which are integrated here, or its own solver. Null
    takes the derivatives if it has them."""

    time_limit: Annotated[Positive, Unit("s")] = 60.0
    """Longest time that the command or function may take to step one state. Each further state in
    a call may take ten times what one took in the first call. A state that takes longer is given
    up."""

    keep: bool = True
    """Whether results of calls that take more than 5 ms are kept on disk for later runs. They count
    as long as the program's own files are the same: set false if it reads others that change."""

    fields: list[str] | None = None
    """Fields that the program steps; null for all. The others have equations."""


@dataclass(kw_only=True)
class Structure:
    """A port-Hamiltonian form of the equations: ``(J - R)*dH/dx + G*u``; zeros may be omitted."""

    H: str
    """The energy, or with axes its density, which may contain grad2 and derivatives."""

    J: dict[str, dict[str, str]]
    """Skew-symmetric matrix of energy exchange, by equation, then field."""

    R: dict[str, dict[str, str]] = field(default_factory=dict)
    """Symmetric, positive semi-definite matrix of dissipation, by equation, then field."""

    G: dict[str, dict[str, str]] = field(default_factory=dict)
    """Port matrix, by equation, then input."""


@dataclass(kw_only=True)
class System:
    """A simulator, declared by its equations. Expressions are in the equation language."""

    title: str
    """Title of the system in reports."""

    axes: dict[str, Axis] = field(default_factory=dict)
    """Spatial axes by name, at most two; none for an ODE."""

    nodes: str | None = None
    """Instead of axes, for a program on an irregular mesh: path of the coordinates of its nodes. It
    is a table with a line of names, ``x`` or ``x, y``, and a line for each node, or a NetCDF file
    (``.nc``) with a variable for each coordinate."""

    fields: dict[str, str]
    """Fields of the state: name and description of each. A unit may follow the description in
    square brackets: ``theta: angle from hanging [rad]``; inside { } such a text needs quotes."""

    parameters: dict[str, float] = field(default_factory=dict)
    """Constants of the equations, by name. ``R: {value: 2.7, spread: 1.0}`` is short for a value
    and its ``parameter_spread``."""

    parameter_spread: dict[str, float] = field(default_factory=dict)
    """Prior standard deviations of parameters that are known only roughly. They are fitted together
    with the initial state. A parameter that is not listed has exactly its value."""

    parameter_per: dict[str, str] = field(default_factory=dict)
    """Uncertain parameters with a value of their own in every ``episode``, all with the same stated
    value and spread. ``m: {value: 1, spread: 0.2, per: episode}`` is the short form. No episode is
    then held out as a whole."""

    tables: dict[str, Table] = field(default_factory=dict)
    """Functions given by points, such as a characteristic curve: ``interp(q, OCV)`` is the value of
    the table OCV at q."""

    let: dict[str, str] = field(default_factory=dict)
    """Derived quantities: name and expression of each."""

    equations: dict[str, str] = field(default_factory=dict)
    """Right-hand side of d(field)/dt, for every field."""

    snapshots: str | None = None
    """Instead of equations: trajectories of a black-box simulator, as a NetCDF file (``.nc``) or
    a Zarr folder with one variable per field over ``(member, time, *axes)``."""

    simulator: ExternalSimulator | None = None
    """Instead of equations, or beside them: a program. The equations that are given, and the law
    that is found, act after each of its steps."""

    class_: str | None = None
    """Instead of equations: ``MODULE.CLASS`` of a simulator in Python, whose code runs only with
    ``trust=MODULE.CLASS`` on the command line."""

    start: dict[str, Any] = field(default_factory=dict)
    """Nominal initial state of every field: a number, or an expression in the coordinates. In
    it, ``x_length`` is the length of the axis x. Required, except with snapshots. ``q: {value:
    1, spread: 0.1}`` is short for a value and its ``spread``. The start is fitted in every
    episode by itself."""

    spin_up: Annotated[NonNegative, Unit("the system's time")] = 0.0
    """Time that the simulator runs before the start, so that it starts on its attractor."""

    spin_up_dt: Time | None = None
    """Time step of the spin-up, which may be less accurate; null keeps integrator.dt."""

    spread: dict[str, Any] = field(default_factory=dict)
    """Prior standard deviation of the initial state. Either per field, as a number or a share of
    its rms such as 10%, smooth over a correlation ``length``; or one smooth random function g that
    perturbs several fields: ``kind: gaussian-process`` with ``length``, number of ``modes``, and
    ``apply``, the expression in g of each perturbed field. Without ``modes``, as many are fitted as
    hold all but 1e-4 of the variance. A field that is not listed starts exactly as given."""

    energy: str | None = None
    """Energy of the system as an expression in fields, parameters and lets. The report gives the
    loss per cycle of the corrected system; null omits it."""

    structure: Structure | None = None
    """Port-Hamiltonian form, against which the equations are checked; null omits the check."""

    front: str | None = None
    """Field with a front that moves around a periodic axis; the report shows its position and
    width."""

    inputs: dict[str, Input] = field(default_factory=dict)
    """Measured inputs, by name in the equations."""

    units: dict[str, str] = field(default_factory=dict)
    """Units of fields, axes, parameters, lets, inputs, and of time as t. Texts and figures show
    them. The values of a recording with other units are converted to these."""

    integrator: Integrator
    """Integration in time and space."""
