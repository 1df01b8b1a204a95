"""Files of nodes: what is read, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred.core.errors import InputError
from dashred.physics.grids.mesh import open_mesh
from dashred.physics.grids.nodes_file import read_nodes
from tests.physics.grids.test_stencils import scattered

NODES = scattered(30, 2)
LINES = ["x, y", *(f"{x:.6f}, {y:.6f}" for x, y in NODES)]


def written(folder: Path, lines: list[str]) -> str:
    path = folder / "nodes.csv"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def refused(path: str) -> str:
    with pytest.raises(InputError) as error:
        read_nodes(path)
    return str(error.value)


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
def test_a_table(tmp_path: Path, separator: str) -> None:
    lines = ["# made by hand", "", *(line.replace(", ", separator) for line in LINES)]
    found = read_nodes(written(tmp_path, lines))
    assert list(found) == ["x", "y"]
    np.testing.assert_allclose(np.stack(list(found.values()), axis=1), NODES, atol=1e-6)


def test_netcdf(tmp_path: Path) -> None:
    path = tmp_path / "nodes.nc"
    xr.Dataset({"x": ("node", NODES[:, 0]), "y": ("node", NODES[:, 1])}).to_netcdf(
        path, engine="h5netcdf"
    )
    found = read_nodes(str(path))
    np.testing.assert_array_equal(found["x"], NODES[:, 0])
    np.testing.assert_array_equal(found["y"], NODES[:, 1])


def test_equal_nodes_are_one_mesh(tmp_path: Path) -> None:
    path = written(tmp_path, LINES)
    assert open_mesh(path) is open_mesh(path)
    assert open_mesh(path).nodes.flags.writeable  # torch warns of arrays that are not


def test_a_changed_file_is_read_again(tmp_path: Path) -> None:
    path = written(tmp_path, LINES)
    before = open_mesh(path)
    Path(path).write_text("\n".join([*LINES, "3, 3"]))
    assert len(open_mesh(path).nodes) == len(before.nodes) + 1


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([*LINES, LINES[7]], "this node is the same as that of"),
        ([*LINES, "nan, 1"], "the coordinate x of a node is not finite"),
        ([*LINES, "1, two"], "'two' is not a number"),
        ([*LINES, "1"], "a node has 1 numbers, but there are 2 coordinates"),
        (LINES[:10], "9 nodes are too few for derivatives: they need 20"),
        (["x", "0", "1"], "2 nodes are too few for derivatives: they need 8"),
        (["x,y", *(f"{k},{2 * k}" for k in range(40))], "all nodes lie on one line"),
        (["x,y", *(f"{k},{j}" for k in range(20) for j in range(3))], "lie on a few lines"),
        (["x,y,z", "1,2,3"], "nodes have one or two coordinates, not x, y, z"),
        (["x,x", "1,2"], "nodes have one or two coordinates, not x, x"),
        (["1,2", "1,2"], "'1' cannot be a coordinate"),
        ([], "the file of the nodes is empty"),
        (["x,y"], "0 nodes are too few"),
    ],
)
def test_what_is_refused(tmp_path: Path, lines: list[str], message: str) -> None:
    told = refused(written(tmp_path, lines))
    assert message in told
    assert "nodes.csv" in told


def test_the_line_of_a_wrong_node_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, [*LINES, LINES[7]])
    assert f"{path}:{len(LINES) + 1}: " in refused(path)
    assert f"{path}:8" in refused(path)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    assert "No such file" in refused(str(tmp_path / "nodes.csv"))
    (tmp_path / "nodes.nc").write_text("text")
    assert "the nodes cannot be read" in refused(str(tmp_path / "nodes.nc"))


def test_variables_over_several_dimensions(tmp_path: Path) -> None:
    path = tmp_path / "nodes.nc"
    xr.Dataset({"x": ("i", NODES[:, 0]), "y": ("j", NODES[:, 1])}).to_netcdf(
        path, engine="h5netcdf"
    )
    assert "not numbers over one dimension" in refused(str(path))
