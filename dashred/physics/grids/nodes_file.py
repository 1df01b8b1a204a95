"""Reader of the nodes of a mesh: a table of text, or NetCDF."""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dashred.core.errors import InputError
from dashred.physics.grids.stencils import DegenerateNodesError, local_weights, stencil_size

Array = NDArray[np.float64]

# Share of the extent of the nodes below which two are the same, or all lie on one line.
SAME = 1e-9


def read_nodes(path: str) -> dict[str, Array]:
    """Return the coordinates of the nodes by name; a process reads a file once.

    Raises:
        InputError: see :func:`_read`.
    """
    file = Path(path)
    return _read(path, file.stat().st_mtime_ns if file.exists() else None)


@lru_cache
def _read(path: str, changed: int | None) -> dict[str, Array]:
    """Return the coordinates of the nodes by name, ``(node,)`` each; one or two coordinates.

    A table has a line of names, such as ``x, y``, and a line for each node. A NetCDF file (``.nc``)
    has a variable for each coordinate, over one dimension.

    Raises:
        InputError: the file cannot be read; it has other columns, or a value that is not a finite
            number; two nodes are the same; there are too few, or all lie on a line.
    """
    netcdf = Path(path).suffix == ".nc"
    coordinates, places = _read_netcdf(path) if netcdf else _read_table(path)
    _check_names(tuple(coordinates), path)
    for name, values in coordinates.items():
        if bad := np.flatnonzero(~np.isfinite(values)).tolist():
            raise InputError(f"the coordinate {name} of a node is not finite", where=places[bad[0]])
    _check_nodes(np.stack(list(coordinates.values()), axis=1), places, path)
    return coordinates


def _read_table(path: str) -> tuple[dict[str, Array], list[str]]:
    """Return the coordinates, and where each node stands."""
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"the nodes cannot be read: {reason}", where=path) from None
    rows = [
        (f"{path}:{number}", words)
        for number, line in enumerate(lines, start=1)
        if (words := [word for word in re.split(r"[,;\s]+", line.partition("#")[0]) if word])
    ]
    if not rows:
        raise InputError("the file of the nodes is empty", where=path)
    (_, names), *rest = rows
    _check_names(tuple(names), rows[0][0])
    for place, words in rest:
        if len(words) != len(names):
            what = f"a node has {len(words)} numbers, but there are {len(names)} coordinates"
            raise InputError(what, where=place)
    columns = np.array([[_number(word, at) for word in words] for at, words in rest])
    columns = columns.reshape(len(rest), len(names))
    return dict(zip(names, columns.T, strict=True)), [place for place, _ in rest]


def _read_netcdf(path: str) -> tuple[dict[str, Array], list[str]]:
    import xarray as xr

    try:
        with xr.open_dataset(path, engine="h5netcdf", chunks=None) as dataset:
            found = {str(name): dataset[name] for name in sorted(map(str, dataset.variables))}
            dims = {variable.dims for variable in found.values()}
            values = {name: variable.values for name, variable in found.items()}
    except Exception as error:  # HDF5 raises many kinds of errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"the nodes cannot be read: {reason}", where=path) from None
    if len(dims) != 1 or any(v.ndim != 1 or v.dtype.kind not in "fiu" for v in values.values()):
        what = "the variables of the nodes are not numbers over one dimension"
        raise InputError(what, where=path, hint="write x, and y in the plane, over one dimension")
    size = len(next(iter(values.values())))
    places = [f"{path}, node {index}" for index in range(size)]
    return {name: v.astype(np.float64) for name, v in values.items()}, places


def _number(word: str, where: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{word!r} is not a number", where=where) from None


def _check_names(names: tuple[str, ...], where: str) -> None:
    hint = "the first line has the names of the coordinates: x, or x, y"
    if not 1 <= len(names) <= 2 or len(set(names)) < len(names):
        what = f"nodes have one or two coordinates, not {', '.join(names) or 'none'}"
        raise InputError(what, where=where, hint=hint)
    for name in names:
        if not (name.isascii() and name.isidentifier()) or name == "node":
            raise InputError(f"{name!r} cannot be a coordinate", where=where, hint=hint)


def _check_nodes(nodes: Array, places: list[str], path: str) -> None:
    count, dimension = nodes.shape
    if count < (least := stencil_size(dimension)):
        what = f"{count} nodes are too few for derivatives: they need {least}"
        raise InputError(what, where=path)
    extent = float(np.ptp(nodes, axis=0).max())
    pairs = cKDTree(nodes).query_pairs(SAME * extent, output_type="ndarray")
    if len(pairs):
        first, second = pairs[0]
        what = f"this node is the same as that of {places[first]}"
        raise InputError(what, where=places[second], hint="remove one of them")
    sizes = np.linalg.svd(nodes - nodes.mean(axis=0), compute_uv=False)
    if sizes[-1] < SAME * sizes[0]:
        what, hint = "all nodes lie on one line", "give one coordinate, along this line"
        raise InputError(what, where=path, hint=hint)
    try:
        local_weights(nodes, nodes, [(0,) * dimension])
    except DegenerateNodesError as error:
        at = ", ".join(f"{x:g}" for x in error.place)
        what = f"the nodes around ({at}) lie on a few lines: derivatives are not determined there"
        raise InputError(what, where=path, hint="add nodes beside these lines") from None
