"""What each kind of program implements: one call that steps one state or a batch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NoReturn, Protocol

from dashred.physics.external.state_batch import Array, ProgramError, StateBatch


@dataclass(frozen=True)
class Way:
    """A way to call a program ``(state, t, dt, inputs, parameters)``.

    Attributes:
        batch: whether a field is ``(batch, *grid)``, else ``(*grid)``.
        arrays: whether t, dt and inputs are arrays ``(batch, *1)`` that broadcast against a field,
            else numbers.
    """

    batch: bool
    arrays: bool


SINGLE, SAME_TIME, ANY_TIME = Way(False, False), Way(True, False), Way(True, True)


class Unread:
    """A time that cannot be read: a program that returns has not used the time."""

    def _refuse(self, *_: object) -> NoReturn:
        raise ProgramError("reads the time")

    __eq__ = __ne__ = __bool__ = __str__ = __repr__ = __format__ = _refuse
    __hash__ = None  # type: ignore[assignment]


class Adapter(Protocol):
    """A kind of program.

    Attributes:
        name: of the program, for messages.
        place: location of its key in the configuration.
        fields: of the system, in their order.
        alone: ways to call it with one state, the first one that works is used.
        together: ways to call it with many states; those that do not give what single calls give
            are not used.
    """

    name: str
    place: str
    fields: tuple[str, ...]

    @property
    def alone(self) -> tuple[Way, ...]: ...  # noqa: D102

    @property
    def together(self) -> tuple[Way, ...]: ...  # noqa: D102

    @property
    def at_once(self) -> int:
        """Number of calls that may run at the same time, in threads."""

    def call(self, batch: StateBatch, way: Way, time: Unread | None = None) -> Array:
        """Call the program once and return the states, ``(batch, field, *grid)``.

        Args:
            batch: the states; one if the way has no batch, with equal times if it has no arrays.
            way: one of the ways of this adapter.
            time: takes the place of t.

        Raises:
            ProgramError: the program fails, changes its argument, or does not return a state.
        """

    def sha256(self) -> str:
        """Return the hash of the program's contents, as far as they are known."""
