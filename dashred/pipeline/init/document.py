"""The text of a first configuration: every block with what it means and what is left to do."""

from __future__ import annotations

import json
import re

from dashred.config.checks.placeholders import TO_DO
from dashred.config.schema.types import NAME
from dashred.config.source import SCALARS
from dashred.core.templates import render
from dashred.data.recording import Recording
from dashred.data.resampling import coarser_step, native_step
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.pipeline.init.columns import Guessed
from dashred.pipeline.init.guess import Guess

PLAIN = re.compile(r"[A-Za-z0-9_./~][A-Za-z0-9_./~ ()+-]*\Z")
TEMPLATE = "pipeline/init/templates/configuration.yaml.j2"


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
    # On a shorter step most values would be missing.
    uneven = guess.every is not None and guess.every == coarser_step(recording)
    return render(
        TEMPLATE,
        axes=guessed.axes,
        fields=guessed.fields,
        functions=list(FUNCTIONS),
        units=recording.units,
        guess=guess,
        examples={field: _example(field, guessed, guess) for field in guessed.fields},
        native_step=native_step(recording.times),
        uneven=uneven,
        path=path,
        table=table,
        name=name,
        title=_title(path),
        to_do=TO_DO,
        key=_key,
        quoted=quoted,
    )


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


def _example(field: str, guessed: Guessed, guess: Guess) -> str:
    """Return what a rate of change might look like."""
    if guessed.axes:
        return f"-c*d({field}, {guessed.axes[0].name}) + D*lap({field})"
    integrals = [name for name, rate in guess.rates.items() if rate.rate == field]
    return f"-k*{(integrals or [field])[0]}"
