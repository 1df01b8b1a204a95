"""The text of a first configuration: every block with what it means and what is left to do."""

from __future__ import annotations

import json
import re

from dashred.config.checks.placeholders import TO_DO
from dashred.config.schema.types import NAME
from dashred.config.source import SCALARS
from dashred.data.recording import Recording
from dashred.data.resampling import fuller_step, own_step
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.pipeline.init.columns import Guessed
from dashred.pipeline.init.guess import Guess

PLAIN = re.compile(r"[A-Za-z0-9_./~][A-Za-z0-9_./~ ()+-]*\Z")
WHERE_COMMENTS_STAND = 30

HEAD = """\
# A first configuration for {recording}, written by `python -m dashred.pipeline.init.command`.
#
# Lines marked {to_do} are yours to fill in: take the mark away when that is done. All other values
# are guesses from the recording, or defaults, which you may change. Then
#   python -m dashred.pipeline.check.command conf={name}    says within seconds what is wrong, doubtful or left to do
#   python -m dashred.train conf={name}    finds what the simulator leaves out
# Every other key, with its meaning and default: python -m dashred.reference

system:                       # the simulator: your equations, as far as you know them
  title: {title}
"""

EQUATIONS = """
  # d(field)/dt as far as you know it: what is missing here is what the analysis looks for. Numbers,
  # + - * / **, {functions}, t, fields and parameters{space}.
  # With 0 nothing moves. Text that holds ', ' or ': ' needs quotes.
  equations:
"""

OF_SPACE = """,
  # and in space d(u, x), d(u, x, 2), lap(u), inv_lap(u), grad2(u), flux(u, x)"""

DOMAIN = """
  # The domain, from 0 to its length. points: of the grid; twice as many must not change what the
  # sensors read. ends: periodic | insulated (no slope) | fixed (zero).
  axes:
"""

FIELDS = """
  # The state: each field with its meaning, which the report calls it by.
  fields:
"""

AFTER_FIELDS = """\
    # a field that no sensor reads may stand here too, with its own equation, start and spread; a
    # column that drives the system (a voltage, a force) is no field but an input: take it out of
    # fields, equations, start and spread, and write below, at their depth, inputs: {e: column}
"""

UNITS = """
  # As the recording states them; t is the time. Nothing is converted: equations are to be in them.
  units:
"""

UNITS_UNKNOWN = """
  # Stated here, units go into findings and figures; nothing is converted, equations are in them.
  # units: {t: s}
"""

START = """
  # The state at the first sample: numbers, or expressions in parameters and coordinates.
  start:
"""

RECORDING = """
recording:                    # paths count from this file's folder
  path: {path}
"""

ODE_NETWORK = """
# A state of few numbers needs a small network (SHRED) and few simulations to learn from.
simulation: {{members: 64, held_out: 16}}
shred: {{lags: 12, latent: 32, decoder: [64, 64], modes: {fields}, epochs: 14}}
"""

PDE_NETWORK = """
# Simulations that the network (SHRED) learns from, and how many POD modes it rebuilds a field from:
# more of both for a richer field, at more time.
simulation: {members: 96, held_out: 16}
shred: {modes: 48, epochs: 20}
surrogate: {members: 96}
"""


def document(
    guessed: Guessed, recording: Recording, guess: Guess, path: str, table: str | None, name: str
) -> str:
    """Return the configuration as YAML.

    Args:
        guessed: names and places.
        recording: as it was read.
        guess: the numbers.
        path: of the recording, seen from the configuration.
        table: of its sensors, likewise; None without one.
        name: of the configuration, as commands name it.
    """
    parts = [
        HEAD.format(recording=quoted(path), to_do=TO_DO, name=name, title=quoted(_title(path))),
        _axes(guessed),
        _fields(guessed),
        _units(recording),
        "\n  parameters: {}              # constants of the equations: {g: 9.81, length: 0.5}\n",
        EQUATIONS.format(functions=" ".join(FUNCTIONS), space=OF_SPACE if guessed.axes else ""),
        *(_equation(field, guessed, guess) for field in guessed.fields),
        _start(guessed, guess),
        _integrator(guessed, guess),
        RECORDING.format(path=quoted(path)),
        _sensors(table),
        _every(recording, guess),
        PDE_NETWORK if guessed.axes else ODE_NETWORK.format(fields=len(guessed.fields)),
    ]
    return "".join(parts)


def quoted(text: str) -> str:
    """Return a text so that YAML reads it as that text."""
    plain = PLAIN.match(text) and not any(kind.match(text) for kind in SCALARS.values())
    return text if plain and text == text.strip() else json.dumps(text, ensure_ascii=False)


def _title(path: str) -> str:
    stem = path.replace("\\", "/").rpartition("/")[2].rpartition(".")[0]
    return stem.replace("_", " ").strip() or "recording"


def _key(name: str) -> str:
    assert NAME.match(name)
    return quoted(name)


def _line(text: str, comment: str) -> str:
    return f"{text + '  ':<{WHERE_COMMENTS_STAND}}# {comment}\n"


def _axes(guessed: Guessed) -> str:
    if not guessed.axes:
        return ""
    lines = [DOMAIN]
    for axis in guessed.axes:
        entry = f"{{length: {axis.length:g}, points: {axis.points}, ends: periodic}}"
        todo = f"{TO_DO}: the domain's length and ends; sensors reach as far as this"
        lines.append(_line(f"    {_key(axis.name)}: {entry}", todo))
    return "".join(lines)


def _fields(guessed: Guessed) -> str:
    lines = [FIELDS, *(f"    {_key(field)}: {quoted(field)}\n" for field in guessed.fields)]
    return "".join(lines) + AFTER_FIELDS


def _units(recording: Recording) -> str:
    """State the units that the files do: the whole configuration is to be in them."""
    if not recording.units:
        return UNITS_UNKNOWN
    lines = [f"    {_key(name)}: {quoted(unit)}\n" for name, unit in recording.units.items()]
    return "".join([UNITS, *lines])


def _equation(field: str, guessed: Guessed, guess: Guess) -> str:
    rate = guess.rates.get(field)
    if rate is not None:
        says = f"a guess: its integral explains {rate.explained:.1%} of the changes of {field}"
        return _line(f"    {_key(field)}: {quoted(rate.rate)}", says)
    integrals = [name for name, rate in guess.rates.items() if rate.rate == field]
    example = f"-k*{(integrals or [field])[0]}"
    if guessed.axes:
        example = f"-c*d({field}, {guessed.axes[0].name}) + D*lap({field})"
    says = f"{TO_DO}: write what you know of d({field})/dt, for example {example}"
    return _line(f"    {_key(field)}: 0", says)


def _start(guessed: Guessed, guess: Guess) -> str:
    lines = [START]
    of_one = guess.episodes == 1
    begins = "first value of the recording" if of_one else "mean of the episodes' first values"
    if guessed.axes:
        lines.append("    # waves through the sensors' first values\n")
    for field in guessed.fields:
        text = f"    {_key(field)}: {guess.start[field]}"
        lines.append(f"{text}\n" if guessed.axes else _line(text, begins))
    lines.append(
        "\n  # How far the true start may lie from it: standard deviations, in each field's unit"
    )
    lines.append(
        ",\n  # smooth in space over length.\n  spread:\n" if guessed.axes else ".\n  spread:\n"
    )
    lines += [f"    {_key(field)}: {guess.spread[field]:g}\n" for field in guessed.fields]
    if guessed.axes:
        lines.append(f"    length: {min(axis.length for axis in guessed.axes) / 10:.3g}\n")
        if len(guessed.axes) > 1:
            lines.append(_line("    modes: 100", "the strongest patterns in space alone"))
    return "".join(lines)


def _integrator(guessed: Guessed, guess: Guess) -> str:
    method = "" if guessed.axes else "method: rk4, "
    says = "the largest time step: half of it must not change what the sensors read"
    return "\n" + _line(f"  integrator: {{{method}dt: {guess.dt:g}}}", says)


def _sensors(table: str | None) -> str:
    if table is None:
        return "  # Columns named like fields are its sensors; none of them has a place.\n"
    return _line(f"  sensors: {quoted(table)}", "name, field, place and noise (std) of each")


def _every(recording: Recording, guess: Guess) -> str:
    own = own_step(recording.times)
    if guess.every is None:
        return _line("  every: null", f"step between samples: the recording's own, {own:.4g}")
    if guess.every == fuller_step(recording):
        says = "on a shorter one most values would be missing: uneven steps, or several clocks"
        return _line(f"  every: {guess.every:g}", says)
    says = f"its own step is {own:.4g}: with this one 16 samples still draw its fastest period"
    return _line(f"  every: {guess.every:g}", says)
