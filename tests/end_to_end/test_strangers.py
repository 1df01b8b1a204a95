"""A stranger's configuration and recording run no code, and touch nothing outside the output."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.core.files.external_links import check_folder, check_hdf5
from dashred.data.io.read_netcdf import read_netcdf
from dashred.physics.black_box.snapshot_file import open_snapshots
from dashred.physics.system import System
from dashred.reporting.figures.style import new_figure, save_figure
from tests.conftest import CHECKOUT, run_command
from tests.end_to_end.test_bad_input import SENSORS, csv_text
from tests.end_to_end.test_train import COARSE

# Whatever turns text or a file into running code.
CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "define"}
MODULES = {"pickle", "cPickle", "dill", "cloudpickle", "marshal", "shelve", "joblib"}
# Code is written from checked expression trees, in which every name is an index, and from Butcher
# tableaux. One function runs it, and three modules call that function.
PHYSICS = CHECKOUT / "dashred" / "physics"
NETWORKS = CHECKOUT / "dashred" / "pipeline" / "networks"
FOREIGN = CHECKOUT / "dashred" / "evaluation" / "foreign" / "cases"
ALLOWED = {
    PHYSICS / "backends" / "codegen.py": ["exec"],
    PHYSICS / "backends" / "numba_backend.py": ["define"],
    # The expressions of the foreign fields are a table of the package.
    FOREIGN / "field_solver.py": ["eval", "compile", "compile", "compile"],
    # Messages through a pipe between processes that one analysis has started, not a file.
    NETWORKS / "fitting.py": ["pickle"],
    NETWORKS / "remote_calls.py": ["pickle.dumps", "pickle.loads"],
}
UNSAFE_YAML = {"load_all", "full_load", "unsafe_load", "full_load_all", "unsafe_load_all"}


def faults_of(tree: ast.AST) -> list[str]:
    """Return what in a module could run what a file says."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in MODULES:
            found.append(node.module)
        elif isinstance(node, ast.Call):
            found += _of_call(node)
    return found


def _of_call(node: ast.Call) -> list[str]:
    said = ast.unparse(node.func)
    name = said.rpartition(".")[2]
    words = {word.arg: ast.unparse(word.value) for word in node.keywords}
    if (said == name and name in CALLS) or said in ("os.system", "os.popen"):
        return [said]
    if said == "torch.load" and words.get("weights_only") != "True":
        return ["torch.load without weights_only=True"]
    if said.partition(".")[0] in MODULES:
        return [said]
    if said.startswith("yaml.") and (name == "load" or name in UNSAFE_YAML):
        return [said]
    if words.get("shell", "False") != "False" or words.get("allow_pickle", "False") != "False":
        return [said]
    return []


def test_no_code_of_ours_runs_what_a_file_says() -> None:
    """Checkpoints, too, are loaded as weights only."""
    for package in ("dashred", "datamodules", "callbacks"):
        for path in (CHECKOUT / package).rglob("*.py"):
            assert faults_of(ast.parse(path.read_text())) == ALLOWED.get(path, []), path


@pytest.mark.parametrize(
    "code",
    [
        "eval(text)",
        "pickle.loads(text)",
        "from marshal import loads",
        "torch.load(path)",
        "torch.load(path, weights_only=False)",
        "yaml.load(text, Loader=yaml.Loader)",
        "subprocess.run(text, shell=True)",
        "np.load(path, allow_pickle=True)",
        "os.system(text)",
    ],
)
def test_the_search_for_such_code_finds_it(code) -> None:
    assert faults_of(ast.parse(code))


WRONG = {
    "a tag": ("title: !!python/object/apply:os.system [touch hacked]", "YAML tags"),
    "a resolver": ("title: ${oc.env:HOME}", "interpolation"),
    "a class": ("title: T\n  class: os.system", "trust=os.system"),
    "a terminal's commands": ('title: "\\e[2J"', "'\\x1b'"),
    "an alias": ("title: &a T\n  energy: *a", "aliases"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_file_that_would_run_code_is_refused(kind, quick, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    text, says = WRONG[kind]
    Path("theirs.yaml").write_text(quick.read_text().replace("title: Burgers", text))
    with pytest.raises(InputError) as caught:
        load_config(["conf=theirs.yaml", "recording.path=a.csv"], entry="train")
    assert says in str(caught.value) and "theirs.yaml:" in str(caught.value)
    assert os.listdir(tmp_path) == ["theirs.yaml"]


@pytest.mark.parametrize(
    "says",
    [
        *("output: ~/.ssh", "output: null", "root: http://evil", "artifacts: s3://evil"),
        *("run: 0123", "parent: 0123"),
    ],
)
def test_a_file_does_not_say_where_results_go(says, quick, tmp_path, monkeypatch) -> None:
    """Else it would choose a folder to be written over, or a server that gets a password."""
    monkeypatch.chdir(tmp_path)
    kept = "tracking: {model: false}\n"
    text = quick.read_text().replace(kept, f"{says}\n")
    key = says.partition(":")[0]
    if key != "output":
        key, text = f"tracking.{key}", quick.read_text().replace("{model: false}", f"{{{says}}}")
    Path("theirs.yaml").write_text(text)
    line = text[: text.index(says)].count("\n") + 1
    with pytest.raises(InputError, match=f"cannot set {key}") as caught:
        load_config(["conf=theirs.yaml", "recording.path=a.csv"], entry="train")
    assert caught.value.where == f"theirs.yaml:{line}"
    assert f"command line: {key}=" in str(caught.value.hint)
    Path("theirs.yaml").write_text(quick.read_text())
    said = {"output": "out", "tracking.root": "runs", "tracking.run": "0", "tracking.parent": "1"}
    words = [f"{key}={value}" for key, value in said.items()]
    config = load_config(["conf=theirs.yaml", "recording.path=a.csv", *words], entry="train")
    assert config.output == str(tmp_path / "out")
    assert config.tracking.root == str(tmp_path / "runs")
    assert (config.tracking.run, config.tracking.parent) == ("0", "1")


@pytest.mark.parametrize("section", ["fields", "parameters", "let", "axes", "inputs"])
@pytest.mark.parametrize("name", ["../u", "/etc", "u/v", "u v", "..", "__class__", "u;v"])
def test_a_name_is_never_a_path(section, name, quick, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    entry = "{length: 1, points: 8}" if section == "axes" else "1"
    text = quick.read_text().replace("system:\n", f"system:\n  extra: {{'{name}': {entry}}}\n", 1)
    Path("theirs.yaml").write_text(text.replace("extra", section, 1))
    with pytest.raises(InputError):
        load_config(["conf=theirs.yaml", "recording.path=a.csv"], entry="train")


def test_a_few_lets_cannot_make_an_endless_expression(quick, tmp_path, monkeypatch) -> None:
    """Each twice in the next: forty lines would be 10¹² names."""
    monkeypatch.chdir(tmp_path)
    lets = "a0: u + 1, " + ", ".join(f"a{i + 1}: sin(a{i}) + cos(a{i})" for i in range(40))
    text = quick.read_text().replace("  equations:", f"  let: {{{lets}}}\n  equations:")
    Path("theirs.yaml").write_text(text)
    with pytest.raises(InputError, match="too large"):
        load_config(["conf=theirs.yaml", "recording.path=a.csv"], entry="train")


def _hdf5_that_reads(secret: Path, kind: str, path: Path) -> None:
    import h5py  # type: ignore[import-untyped]

    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["v"] = np.arange(8.0)
    with h5py.File(path, "w") as file:
        if kind == "a link":
            file.create_group("deep")["value"] = h5py.ExternalLink("secret.h5", "/v")
        elif kind == "a soft link to a link":
            file["value"] = h5py.SoftLink("/hidden")
            file["hidden"] = h5py.ExternalLink("secret.h5", "/v")
        elif kind == "its storage":
            file.create_dataset("value", (8,), dtype="f8", external=[(str(secret), 0, 64)])
        elif kind == "parts of it":
            layout = h5py.VirtualLayout((8,), "f8")
            layout[:] = h5py.VirtualSource("secret.h5", "v", (8,))
            file.create_virtual_dataset("value", layout)
        else:
            file["value"] = np.arange(8.0)
            file["again"] = h5py.SoftLink("/value")


OUTSIDE = {
    "a link": "'deep/value' is a link to another file",
    "a soft link to a link": "'hidden' is a link to another file",
    "its storage": "the values of 'value' are in another file",
    "parts of it": "the values of 'value' are in another file",
}


@pytest.mark.parametrize("kind", OUTSIDE)
@pytest.mark.parametrize("read", [read_netcdf, open_snapshots])
def test_a_data_file_does_not_have_us_read_another(read, kind, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    secret = tmp_path / "secret.bin"
    secret.write_bytes(np.arange(8.0).tobytes())
    _hdf5_that_reads(secret, kind, tmp_path / "theirs.nc")
    with pytest.raises(InputError) as caught:
        read("theirs.nc", None)
    assert caught.value.what == OUTSIDE[kind] and caught.value.where == "theirs.nc"
    _hdf5_that_reads(secret, "nothing else", tmp_path / "own.nc")
    check_hdf5("own.nc")


def test_netcdf_of_the_classic_kind_is_told_how_to_become_new(tmp_path) -> None:
    (tmp_path / "old.nc").write_bytes(b"CDF\x01" + bytes(60))
    with pytest.raises(InputError, match="nccopy -k nc4"):
        check_hdf5(str(tmp_path / "old.nc"))


def test_a_zarr_folder_does_not_have_us_read_another(tmp_path) -> None:
    (tmp_path / "runs" / "u").mkdir(parents=True)
    (tmp_path / "runs" / "u" / "0").write_bytes(b"their own")
    (tmp_path / "runs" / "u" / "1").symlink_to("0")
    check_folder(str(tmp_path / "runs"))
    (tmp_path / "secret").write_bytes(b"mine")
    (tmp_path / "runs" / "u" / "2").symlink_to("../../secret")
    with pytest.raises(InputError, match="u/2 links outside this folder"):
        open_snapshots(str(tmp_path / "runs"), cast(System, None))


def test_a_dollar_in_a_name_is_no_mathematics(tmp_path) -> None:
    figure = new_figure(3, 2)
    axes = figure.add_subplot()
    axes.plot([1, 10], [1, 1000], label="$\\frac{$")
    axes.set_yscale("log")
    axes.set_title("$\\nothing$")
    axes.legend()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_figure(figure, tmp_path / "a.png")
    assert os.listdir(tmp_path) == ["a.png"]


@pytest.mark.parametrize("entry", ["train", "check", "init", "prewarmed"])
def test_a_module_in_the_folder_that_the_user_is_in_does_not_run(tmp_path: Path, entry) -> None:
    for name in ("yaml", "numpy", "torch", "typing_extensions", "mlflow", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\n")
    command = [sys.executable, "-m", "dashred", entry, "conf=rde", "recording.path=none.csv"]
    if entry == "prewarmed":
        module = "dashred.pipeline.check.command"
        command = [sys.executable, "-m", "dashred.pipeline.run.prewarmed", module]
    environment = os.environ | {"PYTHONPATH": str(CHECKOUT)}
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, input="", capture_output=True, text=True
    )
    assert "Traceback" not in done.stderr, done.stderr
    assert not (tmp_path / "ran").exists()


def test_nothing_else_in_the_output_folder_is_sent_to_mlflow(quick, train, tmp_path) -> None:
    """`output=.` is a folder like any other."""
    output = tmp_path / "output"
    (output / "keys").mkdir(parents=True)
    for name in ("keys/id_rsa", "notes.txt", "where.png"):
        (output / name).write_text("mine")
    (tmp_path / "s.csv").write_text(SENSORS)
    (tmp_path / "r.csv").write_text(csv_text())
    words = (f"recording.path={tmp_path / 'r.csv'}", f"recording.sensors={tmp_path / 's.csv'}")
    ended = train(f"conf={quick}", *words, *COARSE)
    assert ended.code == 0, ended.err
    for name in ("keys/id_rsa", "notes.txt", "where.png"):
        assert (output / name).read_text() == "mine"
    [artifacts] = (ended.root / "artifacts").glob("*/artifacts")
    sent = {path.relative_to(artifacts).as_posix() for path in artifacts.rglob("*")}
    assert {"findings.json", "freeze.json", "run.json", "summary.txt"} <= sent
    assert not sent & {"keys", "keys/id_rsa", "notes.txt", "where.png"}


@pytest.mark.slow
def test_evil_names_leave_nothing_outside_the_output(quick, tmp_path) -> None:
    """Of the title, a field's meaning, the sensors and the experiment."""
    evil = "<script>alert(1)</script> $\\frac{$ [/red] ../../up %s {x}"
    names = ["../up", "<b>", "$\\x$", "red]", "/etc/p", "..", "{x}%s"][:6]
    (tmp_path / "theirs").mkdir()
    text = quick.read_text().replace("title: Burgers", f"title: '{evil}'")
    (tmp_path / "theirs" / "theirs.yaml").write_text(text.replace("velocity", f"'{evil}'"))
    table = [f"{name},u,{0.5 + i},0.02" for i, name in enumerate(names)]
    (tmp_path / "theirs" / "s.csv").write_text("\n".join(["name,field,x,std", *table]))
    _, *rows = csv_text().splitlines()
    recording = "\n".join([",".join(["time", *names]), *rows])
    (tmp_path / "theirs" / "r.csv").write_text(recording)
    folder = tmp_path / "a" / "b"
    folder.mkdir(parents=True)
    before = {path for path in tmp_path.rglob("*") if folder not in path.parents}
    ended = run_command(
        folder,
        f"conf={tmp_path / 'theirs' / 'theirs.yaml'}",
        f"recording.path={tmp_path / 'theirs' / 'r.csv'}",
        f"recording.sensors={tmp_path / 'theirs' / 's.csv'}",
        "tracking.experiment=../../up",
    )
    assert ended.code == 0, ended.err
    assert {path for path in tmp_path.rglob("*") if folder not in path.parents} == before
    assert {path.name for path in folder.iterdir()} == {"output", "mlruns"}
    page = ended.read("report.html").decode()
    assert "<script" not in page and "<b>" not in page
    assert evil in json.loads(ended.read("findings.json"))["input"]["config"]["system"]["title"]
