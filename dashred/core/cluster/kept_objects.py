"""Objects that the workers of a cluster keep.

A large object that many calls share is sent once to each worker, which knows it by the hash of its
content. A call names the objects. A worker that does not have one, for example because it was
started again, asks for it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from threading import Lock
from typing import NamedTuple, TypeVar

from dashred.core.threads import compute_in_one_thread

T = TypeVar("T")
# Number of objects that a worker keeps, and that this process remembers as packed.
MOST = 16


class Package(NamedTuple):
    """An object as bytes.

    Attributes:
        name: hash of the content.
        content: the object as Dask serialises it.
    """

    name: str
    content: bytes


class Missing(NamedTuple):
    """The answer of a worker that lacks objects.

    Attributes:
        names: of the objects.
    """

    names: tuple[str, ...]


class Packages:
    """The packages of objects; an object that was packed lately is not packed again."""

    def __init__(self) -> None:
        self._known: list[tuple[object, Package]] = []

    def of(self, thing: object) -> Package:
        """Return the package of an object."""
        for known, package in list(self._known):
            if known is thing:
                return package
        from distributed.protocol.serialize import serialize_bytes

        content = serialize_bytes(thing)
        package = Package(hashlib.sha256(content).hexdigest(), content)
        self._known = [*self._known[1 - MOST :], (thing, package)]
        return package


_kept: dict[str, object] = {}
_lock = Lock()


def call_with_kept(
    names: tuple[str, ...],
    contents: Mapping[str, bytes],
    function: Callable[..., T],
    args: tuple[object, ...],
) -> T | Missing:
    """Call a function with objects that this worker keeps; it computes as an analysis does.

    Args:
        names: of the objects, the first arguments of the function.
        contents: of the objects that are sent.
        function: what is called.
        args: its further arguments.

    Returns:
        Its result, or what this worker lacks.
    """
    with _lock:
        found = [_find(name, contents) for name in names]
    missing = tuple(name for name, thing in zip(names, found, strict=True) if thing is None)
    if missing:
        return Missing(missing)
    compute_in_one_thread()
    return function(*found, *args)


def _find(name: str, contents: Mapping[str, bytes]) -> object | None:
    """Return an object that is kept or sent, and keep it longer than those used before."""
    from distributed.protocol.serialize import deserialize_bytes

    thing = _kept.pop(name, None)
    if thing is None and name in contents:
        thing = deserialize_bytes(contents[name])
    if thing is not None:
        _kept[name] = thing
        for oldest in list(_kept)[:-MOST]:
            del _kept[oldest]
    return thing
