"""Results of expensive calls on disk, by what they follow from."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict
from hashlib import sha256
from typing import TypeVar

import numpy as np

from dashred.core.errors import InputError
from dashred.core.files.state_dir import state_folder
from dashred.physics.external.adapter import Way
from dashred.physics.external.conduct import Conduct
from dashred.physics.external.state_batch import Array, StateBatch

# Calls that take less are not kept, in s: to find them on disk takes as long.
WORTH_KEEPING = 0.005
# When the results take more space, in bytes, the oldest are removed until this share is left.
MOST_BYTES, SHARE_LEFT = 2**30, 0.7
# Seconds to wait for another process that writes.
PATIENCE = 10.0
# SQLite takes a limited number of values in one query.
MOST_KEYS = 500
Result = TypeVar("Result")
TABLE = "CREATE TABLE IF NOT EXISTS results (id INTEGER PRIMARY KEY, key BLOB UNIQUE, value BLOB)"


class KeptResults:
    """Results of one program in a file of SQLite, which is written whole or not at all.

    A result is found by the contents of the program, the state, t, dt, inputs and parameters. If
    the file cannot be used, nothing is kept.
    """

    def __init__(self, program: str) -> None:
        """Set the program, by the hash of its contents and of what it is asked for."""
        self._program = program

    def conduct(self) -> Conduct | None:
        """Return how the program is called, if that was kept."""
        found = self._find([self._key(b"conduct")])[0]
        if found is None:
            return None
        values = json.loads(found)
        return Conduct(**values | {name: Way(**values[name]) for name in ("way", "alone")})

    def keep_conduct(self, conduct: Conduct) -> None:
        """Keep how the program is called."""
        self._keep({self._key(b"conduct"): json.dumps(asdict(conduct)).encode()})

    def keys(self, batch: StateBatch) -> list[bytes]:
        """Return the key of each state of a batch."""
        return [self._key_of_state(batch, row) for row in range(len(batch))]

    def find(self, keys: Sequence[bytes]) -> list[Array | None]:
        """Return the result ``(field * grid,)`` of each key, or None."""
        found = self._find(keys)
        return [None if value is None else np.frombuffer(value) for value in found]

    def keep(self, keys: Sequence[bytes], results: Array) -> None:
        """Keep the results ``(batch, field, *grid)``, but not those of states that failed."""
        self._keep(
            {
                key: result.tobytes()
                for key, result in zip(keys, results, strict=True)
                if np.isfinite(result).all()
            }
        )

    def _key_of_state(self, batch: StateBatch, row: int) -> bytes:
        inputs = sorted((name, float(values[row])) for name, values in batch.inputs.items())
        clock = float(batch.t[row]), float(batch.dt[row])
        parameters = sorted((name, float(value)) for name, value in batch.parameters.items())
        words = repr((clock, inputs, parameters, batch.states.shape[1:]))
        return self._key(words.encode() + np.ascontiguousarray(batch.states[row]).tobytes())

    def _key(self, contents: bytes) -> bytes:
        return sha256(self._program.encode() + contents).digest()

    def _find(self, keys: Sequence[bytes]) -> list[bytes | None]:
        def read(database: sqlite3.Connection) -> dict[bytes, bytes]:
            found: dict[bytes, bytes] = {}
            for begin in range(0, len(keys), MOST_KEYS):
                part = keys[begin : begin + MOST_KEYS]
                marks = ", ".join("?" * len(part))
                query = f"SELECT key, value FROM results WHERE key IN ({marks})"
                found |= dict(database.execute(query, part).fetchall())
            return found

        found = _use_database(read) or {}
        return [found.get(key) for key in keys]

    def _keep(self, results: dict[bytes, bytes]) -> None:
        def write(database: sqlite3.Connection) -> None:
            query = "INSERT OR IGNORE INTO results (key, value) VALUES (?, ?)"
            database.executemany(query, results.items())
            _remove_oldest(database)

        _use_database(write)


def _use_database(use: Callable[[sqlite3.Connection], Result]) -> Result | None:
    """Return what is done with the open file; None if the file cannot be used."""
    try:
        path = state_folder("results") / "programs.sqlite"
    except InputError:
        return None
    try:
        with closing(sqlite3.connect(path, timeout=PATIENCE)) as database, database:
            database.execute(TABLE)
            return use(database)
    except sqlite3.OperationalError:  # The disk is full, or another process writes for too long.
        return None
    except sqlite3.DatabaseError:  # The file is damaged: the next call begins a new one.
        path.unlink(missing_ok=True)
        return None


def _remove_oldest(database: sqlite3.Connection) -> None:
    def value(query: str) -> int:
        return int(database.execute(query).fetchone()[0])

    pages = value("PRAGMA page_count") - value("PRAGMA freelist_count")
    if pages * value("PRAGMA page_size") <= MOST_BYTES:
        return
    first, last = value("SELECT min(id) FROM results"), value("SELECT max(id) FROM results")
    kept = first + int((last - first) * (1 - SHARE_LEFT))
    database.execute("DELETE FROM results WHERE id <= ?", [kept])
