"""Messages of a WebSocket, as JSON."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import Any

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message, parse_json

CONNECT_SECONDS, RETRY_SECONDS = 10.0, 1.0


class WebSocket:
    """A connection to a server that sends messages.

    If the server ends the connection in the normal way, the stream has ended. A lost connection is
    made again.

    Raises:
        InputError: the server does not answer.
    """

    def __init__(self, address: str, remarks: Remarks) -> None:
        self.ended = False
        self._address, self._remarks = address, remarks
        self._retry_at = 0.0
        self._opened = ExitStack()
        try:
            self._connection: Any = self._connect()
        except (OSError, self._errors()) as error:
            what = f"the WebSocket cannot be opened: {error or type(error).__name__}"
            raise InputError(what, where=address, hint="is the server running?") from None

    def _connect(self) -> Any:
        from websockets.sync.client import connect

        self._opened.close()
        opened = connect(self._address, open_timeout=CONNECT_SECONDS, proxy=None)
        return self._opened.enter_context(opened)

    @staticmethod
    def _errors() -> type[Exception]:
        from websockets.exceptions import WebSocketException

        return WebSocketException

    def read(self, timeout: float) -> list[Message]:
        """Return the messages that have arrived."""
        if self._connection is None and not self._is_connected_again(timeout):
            return []
        texts = self._received(timeout)
        messages = [parse_json(each, self._address, self._remarks) for each in texts]
        return [message for message in messages if message is not None]

    def _received(self, timeout: float) -> list[str | bytes]:
        from websockets.exceptions import ConnectionClosed, ConnectionClosedOK

        texts: list[str | bytes] = []
        try:
            texts.append(self._connection.recv(timeout=timeout))
            while True:
                texts.append(self._connection.recv(timeout=0))
        except TimeoutError:
            pass
        except ConnectionClosedOK:
            self.ended = True
        except ConnectionClosed:
            self._connection = None
            what = f"{self._address}: the connection is lost; it is made again"
            self._remarks.once("connection", what)
        return texts

    def _is_connected_again(self, timeout: float) -> bool:
        time.sleep(min(timeout, max(0.0, self._retry_at - time.monotonic())))
        if time.monotonic() < self._retry_at:
            return False
        try:
            self._connection = self._connect()
        except (OSError, self._errors()):
            self._retry_at = time.monotonic() + RETRY_SECONDS
            return False
        return True

    def close(self) -> None:
        """End the connection."""
        self._opened.close()
