"""Functions that other processes can call, and that run in this one.

The log of a run and its progress bar cannot be sent to another process. A function that uses them
is sent as the write end of a pipe, and a thread here runs the calls in the order in which they
were made.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any, TypeVar, cast

from lightning.pytorch.utilities import rank_zero_only

Function = TypeVar("Function", bound=Callable[..., None])


class RemoteCalls:
    """The functions of this process that the processes of one fit call.

    Attributes:
        error: first error of a function; None if there was none.
    """

    def __init__(self) -> None:
        self.error: Exception | None = None
        self._receiver, self._sender = get_context("spawn").Pipe(duplex=False)
        self._functions: list[Callable[..., None]] = []

    def accept(self, function: Function) -> Function:
        """Return the function as one that can be sent to the processes of a fit."""
        self._functions.append(function)
        index = len(self._functions) - 1
        return cast(Function, LocalFunction(function, RemoteFunction(self._sender, index)))

    @contextmanager
    def served(self) -> Iterator[None]:
        """Run the calls; at the end, all of them have been run. It can be entered once."""
        thread = Thread(target=self._serve, daemon=True)
        thread.start()
        try:
            yield
        finally:
            # The pipe ends when the processes have closed their copies as well.
            self._sender.close()
            thread.join()

    def _serve(self) -> None:
        while True:
            try:
                index, arguments = pickle.loads(self._receiver.recv_bytes())
            except (EOFError, OSError):
                return
            try:
                self._functions[index](*arguments)
            except Exception as error:
                # The others are still run: a process would wait for ever if its pipe were full.
                self.error = self.error or error


class LocalFunction:
    """A function that is sent to another process as a :class:`RemoteFunction`."""

    def __init__(self, function: Callable[..., None], remote: RemoteFunction) -> None:
        self.function, self.remote = function, remote

    def __call__(self, *arguments: Any) -> None:
        """Call it."""
        self.function(*arguments)

    def __reduce__(self) -> tuple[type[RemoteFunction], tuple[Connection, int]]:
        """Send the write end of the pipe in its place."""
        return RemoteFunction, (self.remote.sender, self.remote.index)


class RemoteFunction:
    """A function of another process, called by the process of rank zero alone."""

    def __init__(self, sender: Connection, index: int) -> None:
        self.sender, self.index = sender, index

    @rank_zero_only
    def __call__(self, *arguments: Any) -> None:
        """Send the arguments."""
        # Connection.send would put tensors into shared memory, which ends with this process.
        self.sender.send_bytes(pickle.dumps((self.index, arguments)))
