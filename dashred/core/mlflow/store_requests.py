"""Requests to an MLflow store, which are repeated while a server does not answer."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import chain, repeat
from typing import TypeVar

from dashred.core.mlflow.connection_errors import first_line, is_outage, store_exceptions
from dashred.core.mlflow.store_address import is_server
from dashred.core.progress import say
from dashred.core.system_errors import ExternalServiceError

# Seconds for which a run waits for a server that does not answer, and between its attempts.
PATIENCE = 300.0
PAUSES, LAST_PAUSE = (1.0, 2.0, 5.0), 10.0

Answer = TypeVar("Answer")


class Requests:
    """Sends the requests of a run to its store.

    A server may be restarted while a run computes, so a run does not end with its first error. A
    folder of this machine is not waited for.

    Args:
        uri: of the store.
        hint: how to go on after a request has failed.

    Attributes:
        gave_up: whether the run has waited in vain, and the store has not answered since.
    """

    def __init__(self, uri: str, hint: str) -> None:
        self.gave_up = False
        self._uri, self._hint = uri, hint
        self._is_silent = False

    def send(self, request: Callable[[], Answer]) -> Answer:
        """Return the answer to a request, and wait for a server that does not answer.

        Raises:
            ExternalServiceError: the store refuses the request, or has not answered for minutes.
        """
        until = time.monotonic() + PATIENCE
        pauses = chain(PAUSES, repeat(LAST_PAUSE))
        while True:
            try:
                answer = request()
            except store_exceptions() as error:
                pause, waits = next(pauses), self._notice(error) and not self.gave_up
                if not waits or time.monotonic() + pause > until:
                    self.gave_up = waits or self.gave_up
                    raise self._failure(error) from error
                time.sleep(pause)
            else:
                self._note_answer()
                return answer

    def attempt(self, request: Callable[[], object]) -> bool:
        """Send a request, which may be repeated later; return whether it was answered.

        Raises:
            ExternalServiceError: the store refuses the request.
        """
        try:
            request()
        except store_exceptions() as error:
            if not self._notice(error):
                raise self._failure(error) from error
            return False
        self._note_answer()
        return True

    def _note_answer(self) -> None:
        if self._is_silent:
            say("  the MLflow store answers again")
        self._is_silent = self.gave_up = False

    def _notice(self, error: Exception) -> bool:
        """Return whether a server does not answer; say so the first time."""
        if not (is_server(self._uri) and is_outage(error)):
            return False
        if not self._is_silent:
            text = f"  the MLflow store does not answer: {first_line(error)}"
            say(f"{text}\n    the run goes on, and waits {PATIENCE:.0f} s where it needs an answer")
        self._is_silent = True
        return True

    def _failure(self, error: Exception) -> ExternalServiceError:
        what = f"MLflow cannot use this store: {first_line(error)}"
        return ExternalServiceError(f"{self._uri}: {what}\n  {self._hint}")
