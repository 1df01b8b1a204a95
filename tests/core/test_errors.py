"""Messages of input errors."""

from __future__ import annotations

import pickle

import pytest

from dashred.core.errors import InputError

FULL = InputError("unknown key shred.lag", where="my.yaml:3", hint="did you mean shred.lags?")


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (FULL, "my.yaml:3: unknown key shred.lag\n  did you mean shred.lags?"),
        (InputError("no recording", where="command line"), "command line: no recording"),
        (InputError("no recording", hint="give one"), "no recording\n  give one"),
    ],
)
def test_message_reads_where_what_hint(error: InputError, text: str) -> None:
    assert str(error) == text


def test_error_survives_a_process_boundary() -> None:
    copy = pickle.loads(pickle.dumps(FULL))
    assert (copy.what, copy.where, copy.hint) == (FULL.what, FULL.where, FULL.hint)
    assert str(copy) == str(FULL)
