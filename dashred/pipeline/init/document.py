"""Text of a first configuration, with comments and marks for the lines to fill in."""

from __future__ import annotations

import json
import re

from dashred.config.checks.placeholders import TO_DO
from dashred.config.schema.types import NAME
from dashred.config.source import SCALARS
from dashred.core.templates import render
from dashred.data.clocks.resampling import coarser_step, native_step
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.recording import Recording
from dashred.physics.expressions.combinations import COMBINATIONS
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.pipeline.init.guess import GuessedValues
from dashred.pipeline.init.guessed_system import GuessedSystem

PLAIN = re.compile(r"[A-Za-z0-9_./~][A-Za-z0-9_./~ ()+-]*\Z")
TEMPLATE = "pipeline/init/templates/configuration.yaml.j2"


def document(
    guessed: GuessedSystem,
    recording: Recording,
    guess: GuessedValues,
    path: str,
    table: str | None,
    layout: TableLayout,
    name: str,
) -> str:
    """Return the configuration as YAML.

    Args:
        guessed: system with its fields and axes.
        recording: longest episode of the recording.
        guess: values guessed from the recording.
        path: path of the recording, relative to the configuration.
        table: path of the sensor table, relative to the configuration; None without a table.
        layout: names of the columns.
        name: path of the configuration, as in a command.
    """
    # With a shorter step most values would be missing.
    uneven = guess.every is not None and guess.every == coarser_step(recording)
    named = (*guessed.fields, *guessed.lets)
    return render(
        TEMPLATE,
        axes=guessed.axes,
        fields=guessed.fields,
        lets=guessed.lets,
        inputs=guessed.inputs,
        held=guessed.held_inputs,
        functions=[*FUNCTIONS, *COMBINATIONS],
        units=recording.units,
        guess=guess,
        examples={name: _example(name, guessed, guess) for name in named},
        native_step=native_step(recording.times),
        uneven=uneven,
        path=path,
        table=table,
        layout=layout,
        name=name,
        title=_title(path),
        to_do=TO_DO,
        key=_key,
        quoted=quoted,
    )


def quoted(text: str) -> str:
    """Return a text as YAML, in quotes if necessary."""
    is_plain = PLAIN.match(text) and not any(kind.match(text) for kind in SCALARS.values())
    return text if is_plain and text == text.strip() else json.dumps(text, ensure_ascii=False)


def _title(path: str) -> str:
    stem = path.replace("\\", "/").rpartition("/")[2].rpartition(".")[0]
    return stem.replace("_", " ").strip() or "recording"


def _key(name: str) -> str:
    assert NAME.match(name)
    return quoted(name)


def _example(field: str, guessed: GuessedSystem, guess: GuessedValues) -> str:
    """Return an example of a right-hand side."""
    if guessed.axes:
        return f"-c*d({field}, {guessed.axes[0].name}) + D*lap({field})"
    integrals = [name for name, rate in guess.rates.items() if rate.rate == field]
    return f"-k*{(integrals or [field])[0]}"
