"""The seal: nothing that the analysis does can depend on the hidden truth."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import xarray as xr

from dashred.config import load_config
from dashred.core.errors import InputError

CHECKOUT = Path(__file__).resolve().parents[1]
PACKAGES = ("dashred", "datamodules", "callbacks")
EVALUATION = "dashred.evaluation"


def module_files() -> dict[str, Path]:
    """Return every module of ours by its dotted name."""
    found = {}
    for package in PACKAGES:
        for path in (CHECKOUT / package).rglob("*.py"):
            parts = path.relative_to(CHECKOUT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


MODULES = module_files()
# The one rule: an analysis imports nothing of these. The baselines are analyses too.
BASELINES = f"{EVALUATION}.baselines"
SECRET_MODULES = {
    name for name in MODULES if name.startswith(f"{EVALUATION}.") and not name.startswith(BASELINES)
}


def imports(module: str, tree: ast.AST) -> set[str]:
    """Return the modules of ours that a piece of code imports, wherever in it that stands."""
    named = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            named |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            package = module.split(".")[: -node.level] if node.level else []
            base = ".".join([*package, *(node.module or "").split(".")]).strip(".")
            named |= {base, *(f"{base}.{alias.name}" for alias in node.names)}
    ours = {name for name in named if name in MODULES}
    return ours | {parent for name in ours for parent in parents(name)}


def parents(name: str) -> Iterator[str]:
    """Yield the packages that importing a module runs."""
    while "." in name:
        name = name.rpartition(".")[0]
        yield name


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text(encoding="utf-8"))


# They hand over to a twin experiment, or its recording, and analyse nothing themselves.
ENTRIES = {"dashred", "dashred.__main__", "dashred.train"}


def reached_from(start: str) -> set[str]:
    seen: set[str] = set()
    waiting = {start}
    while waiting:
        module = waiting.pop()
        if module not in seen:
            seen.add(module)
            if module not in ENTRIES:
                waiting |= imports(module, tree_of(module))
    return seen


DYNAMIC = {"__import__", "import_module", "exec", "eval", "runpy"}
# Kernels are written from checked expressions, with the math module alone in reach. A user's own
# simulator is imported where the command line has named it. A process imports its entry point.
EXCEPT = {
    "dashred.physics.backends.codegen": {"exec"},
    "dashred.physics.external.adapters.user_code": {"import_module"},
    "dashred.pipeline.run.prewarmed": {"import_module"},
}


ANALYSIS = sorted(name for name in MODULES if not name.startswith(EVALUATION))


def test_the_walk_sees_lazy_and_relative_imports() -> None:
    code = "def f():\n    from . import score_command\n    from dashred.data import splits"
    found = imports("dashred.evaluation.twins.recorder", ast.parse(code))
    assert found == {
        "dashred",
        "dashred.evaluation",
        "dashred.evaluation.twins",
        "dashred.evaluation.twins.score_command",
        "dashred.data",
        "dashred.data.splits",
    }
    twins = "dashred.evaluation.twins"
    assert f"{twins}.twin_experiment" in imports("dashred.train", tree_of("dashred.train"))
    scorer = f"{twins}.score_command"
    assert f"{twins}.sealing" in imports(scorer, tree_of(scorer))


def test_nothing_outside_of_the_evaluation_imports_it() -> None:
    for module in set(ANALYSIS) - ENTRIES:
        known = imports(module, tree_of(module))
        assert not {name for name in known if name.startswith(EVALUATION)}, module


def test_the_analysis_reaches_nothing_that_knows_the_truth() -> None:
    reached = reached_from("dashred.pipeline.worker")
    expected = {"dashred.pipeline.outputs.report", "dashred.physics.solvers.simulate", "callbacks"}
    assert expected <= reached
    assert not {name for name in reached if name.startswith(EVALUATION)}


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("analyse", "dashred.evaluation.baselines.kalman_filter"),
        ("assimilations", "dashred.models.dynamics.dynamic_assimilation"),
    ],
)
def test_other_methods_that_read_the_sensors_reach_nothing_that_knows_the_truth(
    entry: str, expected: str
) -> None:
    reached = reached_from(f"{BASELINES}.{entry}")
    assert {"dashred.pipeline.simulation.nominal_run", expected} <= reached
    assert not reached & SECRET_MODULES


def test_the_analysis_imports_by_statement_alone() -> None:
    """Otherwise the walk over import statements would miss an import."""
    entries = (f"{BASELINES}.analyse", f"{BASELINES}.assimilations")
    reached = set().union(*map(reached_from, entries))
    for module in {*ANALYSIS, *reached} - ENTRIES:
        for node in ast.walk(tree_of(module)):
            if isinstance(node, ast.Name | ast.Attribute):
                name = node.id if isinstance(node, ast.Name) else node.attr
                allowed = EXCEPT.get(module, set())
                assert name not in DYNAMIC - allowed, module


def test_only_recorder_and_scorer_import_the_seal() -> None:
    twins = "dashred.evaluation.twins"
    importers = {name for name in MODULES if f"{twins}.sealing" in imports(name, tree_of(name))}
    expected = {f"{twins}.{name}" for name in ("record_command", "score_command", "twin_file")}
    assert expected <= importers <= SECRET_MODULES


@pytest.mark.parametrize("word", ["sealed", "twins", "recorder"])
def test_only_they_name_the_files_of_the_truth(word: str) -> None:
    """Beside them: the guard that refuses twins, and the table of commands, which names modules."""
    naming = set()
    for name in MODULES:
        tree = tree_of(name)
        prose = {
            id(node.value)
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        }
        for node in ast.walk(tree):
            text = node.value if isinstance(node, ast.Constant) and id(node) not in prose else ""
            if isinstance(text, str) and word in text.replace("/", " ").replace(".", " ").split():
                naming.add(name)
    assert naming <= SECRET_MODULES | {"dashred.config.commandline", "dashred.__main__"}
    assert naming


def run_without_the_truth(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Analyse in the proof's copy of the package, which has no trace of the twins."""
    from dashred.evaluation.isolation.worker import isolated_copy

    copy = isolated_copy(folder / "tree")
    # An editable install finds the checkout's own modules for whatever the copy lacks.
    program = (
        "import sys\n"
        "editable = lambda finder: getattr(finder, '__module__', '').startswith('__editable__')\n"
        "sys.meta_path[:] = [finder for finder in sys.meta_path if not editable(finder)]\n"
        "import importlib.util as u, dashred; from pathlib import Path\n"
        f"assert Path(dashred.__file__).is_relative_to({str(copy)!r})\n"
        f"assert u.find_spec({EVALUATION!r}) is None\n"
        "from dashred.core.command_line.entry import run_entry; from dashred.train import main\n"
        "sys.exit(run_entry(main))"
    )
    # The working folder stands first on the path.
    return subprocess.run(
        [sys.executable, "-c", program, *words],
        cwd=copy,
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
    )


def test_the_findings_are_the_same_bytes_without_any_trace_of_the_truth(
    twin_run, quick, tmp_path
) -> None:
    alone = tmp_path / "alone"
    alone.mkdir()
    shutil.copyfile(quick, alone / "quick.yaml")
    shutil.copyfile(twin_run.output / "recording.nc", alone / "recording.nc")
    words = [f"conf={alone / 'quick.yaml'}", f"recording.path={alone / 'recording.nc'}"]
    ended = run_without_the_truth(
        tmp_path, *words, f"output={alone / 'found'}", f"tracking.root={alone / 'mlruns'}"
    )
    assert ended.returncode == 0, ended.stderr
    assert (alone / "found" / "findings.json").read_bytes() == twin_run.read("findings.json")
    assert not list(alone.rglob("*seal*"))


def test_the_analyser_is_told_the_place_of_the_recording_alone(quick, train, processes) -> None:
    ended = train(f"conf={quick}", "recording.twin=b", "recording.noise=0.03", "seed=3")
    assert ended.code == 0, ended.err
    recorder, analyser, scorer = processes
    assert [words[0] for words in processes] == [
        "dashred.evaluation.twins.record_command",
        "dashred.pipeline.analyse",
        "dashred.evaluation.twins.score_command",
    ]
    told = {word.partition("=")[0]: word.partition("=")[2] for word in analyser[1:]}
    assert told.keys() == {
        "conf",
        "seed",
        "recording.path",
        "output",
        "tracking.root",
        "tracking.run",
    }
    assert told["conf"] == str(quick)
    assert Path(told["recording.path"]).name == "recording.nc"
    [private] = [word.partition("=")[2] for word in scorer if word.startswith("sealed=")]
    assert Path(told["recording.path"]).parent != Path(private).parent
    assert {"recording.twin=b", "recording.noise=0.03", "seed=3"} <= set(recorder)


def test_the_step_of_the_analysis_clock_is_no_secret(quick, train, processes) -> None:
    """Else a twin sampled at another step than the file's could not be analysed."""
    ended = train(f"conf={quick}", "recording.every=0.2", "recording.duration=6")
    assert ended.code == 0, ended.err
    assert "recording.every=0.2" in processes[1]
    assert not any(word.startswith("recording.duration") for word in processes[1])


def config_of(quick: Path, *words: str):
    return load_config([f"conf={quick}", *words], entry="record")


def recorded(config):
    """Return the truth's times and states as the recorder makes them, and its random stream."""
    from dashred.evaluation.twins.record_command import _random_key
    from dashred.evaluation.twins.recorder import simulate_truth, truth_times
    from dashred.evaluation.twins.twin_file import read_twin
    from dashred.physics.system import System

    twin = read_twin(config)
    rng = np.random.default_rng(_random_key(twin, config.seed))
    system = System(config.system, config.where)
    with torch.no_grad():
        times = truth_times(config)
        states = simulate_truth(system, twin, config, times, rng, None)
    return times, states, rng, system


def test_no_member_of_the_ensemble_starts_where_the_truth_does(quick) -> None:
    from dashred.physics.runs.ensemble import MemberSource, draw_ensemble
    from dashred.physics.runs.initial_state_prior import StartPrior, nominal_start
    from dashred.physics.solvers.simulate import simulate

    for seed in range(3):
        config = config_of(quick, f"seed={seed}")
        times, states, _, system = recorded(config)
        nominal = simulate(system, nominal_start(system), times[:41])[0]
        rms = nominal.square().mean().sqrt()[None]
        prior = StartPrior(system, nominal[0], rms, None)
        for stream in ([seed, *b"ensemble"], seed):
            rng = np.random.default_rng(stream)
            source = MemberSource(system, times[:5], prior, nominal[:5], None, rng)
            drawn = draw_ensemble(source, 64)
            spread = drawn.states[:, 0].std()
            distance = (drawn.states[:, 0] - states[0]).square().mean(dim=(1, 2)).sqrt()
            assert distance.min() > 0.05 * spread


def test_the_recorders_chance_changes_with_the_law_and_with_the_seed(quick) -> None:
    draws = {}
    for words in (("twin=a",), ("twin=b",), ("twin=null",), ("twin=a", "seed=1")):
        _, states, rng, _ = recorded(config_of(quick, *words))
        draws[words] = (states[0].numpy(), rng.standard_normal(4))
    again = recorded(config_of(quick, "twin=a"))
    np.testing.assert_array_equal(again[1][0].numpy(), draws[("twin=a",)][0])
    starts = [start for start, _ in draws.values()]
    later = [noise for _, noise in draws.values()]
    for i in range(len(draws)):
        for j in range(i):
            assert np.abs(starts[i] - starts[j]).max() > 1e-3
            assert np.abs(later[i] - later[j]).max() > 1e-3


def test_the_truth_runs_at_doubled_resolution(quick) -> None:
    """Its distance to the simulator's own run is the doubling error: small, but not zero."""
    from dashred.physics.solvers.simulate import simulate

    small = ("system.parameters.nu=0.1", "system.axes.x.points=24", "system.spread.u=0")
    times, truth, _, system = recorded(config_of(quick, "twin=null", *small))
    own = simulate(system, truth[:1], times)[0]
    double = simulate(
        system.refined(), system.grid.interpolate(truth[:1], system.refined().grid), times
    )[0]
    error = (own - truth).square().mean().sqrt() / truth.std()
    assert 1e-7 < error < 1e-2
    torch.testing.assert_close(double[..., ::2], truth, rtol=0, atol=1e-9)


def scramble(source: Path, target: Path, findings: dict[str, Any]) -> None:
    """Write noise over everything that the findings claim not to have looked at."""
    splits = findings["input"]["splits"]
    with xr.open_dataset(source, engine="h5netcdf") as dataset:
        changed = dataset.load()
    rng = np.random.default_rng(0)
    values = changed["value"].values
    late = changed["time"].values > splits["time_end"] + 1e-9
    hidden = np.isin(changed["name"].values, splits["test"])
    assert late.sum() >= 8 and hidden.sum() == 1
    unseen = late[:, None] | hidden[None, :]
    values[unseen] = 5 + 3 * rng.standard_normal(int(unseen.sum()))
    changed["value"].values[:] = values
    changed.to_netcdf(target, engine="h5netcdf")


def test_nothing_held_out_has_a_part_in_the_findings(quick, twin_run, train, tmp_path) -> None:
    before = json.loads(twin_run.read("findings.json"))
    scramble(twin_run.output / "recording.nc", tmp_path / "recording.nc", before)
    ended = train(f"conf={quick}", f"recording.path={tmp_path / 'recording.nc'}")
    assert ended.code == 0, ended.err
    after = json.loads(ended.read("findings.json"))
    assert after["fit"]["test_sensors"]["dashred"] > before["fit"]["test_sensors"]["dashred"]
    assert after["fit"]["heldout_time"] != before["fit"]["heldout_time"]
    assert after["input"]["recording_sha256"] != before["input"]["recording_sha256"]
    for findings in (before, after):
        for key in ("test_sensors", "misfit_at_test_sensors", "heldout_time", "comparisons"):
            del findings["fit"][key]
        del findings["input"]["recording_sha256"]
    assert after == before


@pytest.fixture
def copied(twin_run, tmp_path) -> Path:
    """A finished run that may be tampered with."""
    return Path(shutil.copytree(twin_run.output, tmp_path / "copied"))


def test_the_scorer_refuses_findings_before_it_opens_the_seal(copied, monkeypatch) -> None:
    from dashred.evaluation.twins import score_command

    monkeypatch.setattr(
        "dashred.evaluation.twins.sealing.open_seal", lambda _: pytest.fail("the seal was opened")
    )
    words = [f"findings={copied}", f"sealed={copied / 'sealed.nc'}"]
    (copied / "score.json").unlink()
    findings = (copied / "findings.json").read_bytes()
    (copied / "findings.json").write_bytes(findings.replace(b"alg1", b"alg3"))
    with pytest.raises(InputError, match="changed after it was frozen"):
        score_command.main(words)
    (copied / "findings.json").write_bytes(findings)
    with (copied / "estimates.nc").open("ab") as file:
        file.write(b"touched")
    with pytest.raises(InputError, match="changed after it was frozen"):
        score_command.main(words)
    (copied / "freeze.json").unlink()
    with pytest.raises(InputError, match="not been frozen"):
        score_command.main(words)
    assert not (copied / "score.json").exists()


def test_the_scorer_leaves_the_findings_as_they_were(copied, twin_run) -> None:
    from dashred.evaluation.twins import score_command

    frozen = ("findings.json", "estimates.nc", "freeze.json")
    before = {name: (copied / name).read_bytes() for name in frozen}
    assert score_command.main([f"findings={copied}", f"sealed={copied / 'sealed.nc'}"]) == 0
    assert {name: (copied / name).read_bytes() for name in frozen} == before
    assert (copied / "score.json").read_bytes() == twin_run.read("score.json")


def test_no_word_hands_the_twin_to_the_analysis_among_others(quick, train) -> None:
    ended = train(f"conf={quick}", "recording={twin: b, noise: 0.03}")
    assert ended.code == 2 and "recording.noise=0.03" in ended.err


def test_findings_are_frozen_before_the_scorer_starts(quick, train, stand_in, monkeypatch) -> None:
    from dashred.evaluation.twins.twin_experiment import clear_truth

    seen = []

    run = stand_in.run

    def watching(process: object, words: list[str]) -> None:
        output = next((w[9:] for w in words if w.startswith("findings=")), None)
        if output is not None:
            seen.append({path.name for path in Path(output).iterdir()})
        run(process, words)

    monkeypatch.setattr(stand_in, "run", watching)
    ended = train(f"conf={quick}", "recording.twin=null")
    assert ended.code == 0, ended.err
    [before] = seen
    assert "freeze.json" in before and not before & {"sealed.nc", "score.json"}
    assert (ended.output / "sealed.nc").is_file()
    # An analysis that begins anew in this folder finds nothing that shows the truth.
    clear_truth(ended.output)
    assert {path.name for path in ended.output.iterdir()} == before | {"score.json"}
    assert json.loads(ended.read("score.json"))["latent_rank"] == {"alg1": {}, "alg2": {}}
