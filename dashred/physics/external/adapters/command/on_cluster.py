"""Call a command on the cluster of the analysis, if there is one."""

from __future__ import annotations

from secrets import token_hex

from dashred.core.cluster.calls import CallLostError, ClusterCalls, cluster_in_use
from dashred.core.cluster.word import WHERE
from dashred.core.errors import InputError
from dashred.physics.external.adapter import Unread, Way
from dashred.physics.external.adapters.command.command import (
    CommandAdapter,
    CommandWords,
    open_command,
)
from dashred.physics.external.state_batch import Array, ProgramError, StateBatch

# The commands of a worker, by a number of the analysis that calls them.
_opened: dict[str, CommandAdapter] = {}


class ClusterCommandAdapter:
    """A command that runs on the workers of the cluster of the analysis, else on this machine.

    Args:
        words: of the command.
        own: its adapter on this machine.
    """

    def __init__(self, words: CommandWords, own: CommandAdapter) -> None:
        self._words, self._own = words, own
        self._number, self._checked = token_hex(8), set[int]()
        self.fields, self.name, self.place = own.fields, own.name, own.place

    @property
    def alone(self) -> tuple[Way, ...]:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        return self._own.alone

    @property
    def together(self) -> tuple[Way, ...]:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        return self._own.together

    @property
    def at_once(self) -> int:
        """See :class:`dashred.physics.external.adapter.Adapter`."""
        calls = cluster_in_use()
        return self._own.at_once if calls is None else calls.count

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """See :meth:`dashred.physics.external.adapter.Adapter.call`."""
        calls = cluster_in_use()
        if calls is None:
            return self._own.call(batch, way, time)
        self._check(calls)
        try:
            return calls.call(
                call_command, self._number, self._words, batch, way, reads_time=time is None
            )
        except CallLostError as lost:
            raise ProgramError(str(lost)) from None

    def sha256(self) -> str:
        """See :meth:`dashred.physics.external.adapter.Adapter.sha256`."""
        return self._own.sha256()

    def _check(self, calls: ClusterCalls) -> None:
        """Check once that all workers have this program.

        Raises:
            InputError: a worker has none, or another.
        """
        if id(calls) in self._checked:
            return
        words, own = self._words, self.sha256()
        for address, found in sorted(calls.call_on_all(lambda: hash_on_worker(words)).items()):
            if found != own:
                what = "has another version of" if len(found) == len(own) else "cannot run"
                raise InputError(
                    f"the worker {address} {what} {self.name}",
                    where=WHERE,
                    hint="the program, its files and the template must be at the same path on "
                    "every machine",
                )
        self._checked.add(id(calls))


def call_command(
    number: str, words: CommandWords, batch: StateBatch, way: Way, reads_time: bool
) -> Array:
    """Call a command on this worker, which opens it once."""
    if number not in _opened:
        _opened[number] = open_command(words)
    return _opened[number].call(batch, way, None if reads_time else Unread())


def hash_on_worker(words: CommandWords) -> str:
    """Return the hash of a command on this worker; empty if it cannot be opened."""
    try:
        return open_command(words).sha256()
    except (InputError, OSError):
        return ""
