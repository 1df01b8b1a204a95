"""The bench, with runs that take no time: what it starts, what it keeps, and what it counts."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from dashred.core.command_line.argument_types import ranges_reader
from dashred.core.errors import InputError
from dashred.evaluation import bench
from dashred.evaluation.benchmark import processes
from dashred.evaluation.benchmark.arguments import read_words
from dashred.evaluation.benchmark.plan import Row, plan
from dashred.evaluation.benchmark.summary import as_metrics, summarise
from dashred.evaluation.benchmark.table import finished_line, notes, rows_grid, to_markdown
from dashred.pipeline.run.output_dir import make_output

CHECKOUT = Path(__file__).resolve().parents[3]

# Stands in for dashred.train. It fails on twin b of seed 1 until a file `repaired` lies beside it,
# and hangs on twin b of seed 9.
STUB = """
import json, os, pathlib, subprocess, sys, time
words = dict(word.partition("=")[::2] for word in sys.argv[1:])
here, output = pathlib.Path(__file__).parent, pathlib.Path(words["output"])
with (here / "started").open("a") as file:
    print(json.dumps(sys.argv[1:]), file=file)
twin, seed = words["recording.twin"], int(words["seed"])
if (twin, seed) == ("b", 1) and not (here / "repaired").exists():
    print("error: b: the hidden truth blows up")
    print("  a hint")
    sys.exit(2)
if (twin, seed) == ("b", 9):
    below = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    partial = here / ".processes"
    partial.write_text(json.dumps([os.getpid(), below.pid]))
    partial.rename(here / "processes")
    time.sleep(600)
terms = [{"equation": "u", "term": "u", "coefficient": -0.1 - 0.01 * seed, "std": 0.002}]
verdict = "ambiguous" if twin == "b" else "missing-term"
if twin == "null":
    terms, verdict = [], "nothing-missing"
rmse = {"dashred": 0.2, "corrected": 0.04, "corrected_shred": 0.1, "simulation_refit": 0.16}
rmse |= {"simulation": 0.8, "simulation_same_start": 0.4 + seed}
score = {
    "exact_support": twin != "b",
    "coefficient_error": None if twin == "b" else 0.0 if twin == "null" else 0.1 * seed,
    "field_rmse": rmse,
    "field_rmse_by_field": {"u": rmse},
    "forecast": {"before": 1.0, "before_refit": 0.7, "after": 0.3},
}
seconds = {"discover": 3.0, "in all": 10.0 + seed}
run = {"seconds": seconds, "git_commit": "0123abc", "mlflow_run": "r"}
findings = {"verdict": verdict, "terms": terms}
for name, content in {"findings": findings, "score": score, "run": run}.items():
    (output / f"{name}.json").write_text(json.dumps(content))
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One store for the module: creating the tables takes MLflow a second."""
    return tmp_path_factory.mktemp("store") / "mlruns"


class Stub:
    """The stand-in for training, and a bench in a folder of its own."""

    def __init__(self, folder: Path, quick: Path, root: Path) -> None:
        """Write the stub."""
        self.folder, self.output, self.quick, self.root = folder, folder / "bench", quick, root
        (folder / "stub.py").write_text(STUB)

    def words(self, *words: str) -> list[str]:
        """Return the words of a bench that leaves nothing in the checkout."""
        own = [f"output={self.output}", f"tracking.root={self.root}"]
        if not any(word.startswith("systems=") for word in words):
            own.append(f"systems={self.quick}")
        return [*own, *words]

    def bench(self, *words: str) -> int:
        """Run a bench; returns its exit code."""
        return bench.main(self.words(*words))

    def started(self) -> list[dict[str, str]]:
        """Return the words of every run so far, and forget them."""
        file = self.folder / "started"
        lines = file.read_text().splitlines() if file.exists() else []
        file.unlink(missing_ok=True)
        return [dict(word.partition("=")[::2] for word in json.loads(line)) for line in lines]

    def table(self) -> dict[str, Any]:
        """Return ``table.json``."""
        return dict(json.loads((self.output / "table.json").read_text()))


@pytest.fixture
def stub(tmp_path: Path, quick: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> Stub:
    stub = Stub(tmp_path, quick, root)
    command = [sys.executable, "-S", str(tmp_path / "stub.py")]
    monkeypatch.setattr(processes, "train_command", lambda words: [*command, *words])
    return stub


# --- words ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("3", (3,)), ("0-4", (0, 1, 2, 3, 4)), ("0,1,3", (0, 1, 3)), ("2,0-2,7", (2, 0, 1, 7))],
)
def test_seeds_are_ranges_and_lists(text: str, seeds: tuple[int, ...]) -> None:
    assert ranges_reader(at_most=10_000)(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "1,,2", "4-0", "-1", "1.5", "0-99999999", "1-2-3"])
def test_what_is_no_seed_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InputError) as caught:
        read_words(["systems=rde", f"seeds={text}"])
    assert caught.value.where == "command line"
    assert caught.value.hint and "seeds=" in caught.value.hint


@pytest.mark.parametrize(
    ("word", "says", "hint"),
    [
        ("sytems=rde", "unknown key sytems", "systems"),
        ("seed=1", "seed= is not a word of dashred bench", "seeds="),
        ("conf=rde", "conf= is not a word of dashred bench", "systems="),
        ("recording.twin=a", "recording.twin= is not a word", "twins="),
        ("recording.noise=0.1", "recording.noise= is not a word", "noise="),
        ("recording.path=my.csv", "recording.path= is not a word", "dashred train"),
        ("shred.lag=3", "unknown key shred.lag", "shred.lags"),
        ("noise=loud", "noise=loud: 'loud' is not a number", "noise=0.01,0.05"),
        ("noise=-0.1", "recording.noise must be at least 0", None),
        ("noise=nan", "noise=nan: 'nan' is not a number", None),
        ("jobs=0", "jobs=0: 0 is not between 1 and", "jobs=2"),
        ("sensors=few", "sensors=few: 'few' is not a whole number", "sensors=own,4,8"),
        ("sensors=0", "recording.sensors", None),
        ("recording.sensors=4", "recording.sensors= is not a word", "sensors="),
        ("twins=a,z", "has no twin 'z'", "choose from: a, b, null"),
        ("twins=a,,b", "empty value", "twins=a,b"),
        ("twins=", "twins= is empty", "twins=a,b"),
        ("systems=rde,rdee", "unknown conf 'rdee'", "conf=rde"),
        ("--jobs=2", "expected key=value", "write jobs=2"),
        ("threads", "expected key=value", "--help"),
    ],
)
def test_bad_words_are_refused_before_anything_is_written(
    stub: Stub, word: str, says: str, hint: str | None
) -> None:
    with pytest.raises(InputError) as caught:
        stub.bench(word)
    assert says in caught.value.what
    if hint is not None:
        assert caught.value.hint and hint in caught.value.hint
    assert not stub.output.exists() and not stub.started()


def test_systems_are_needed(stub: Stub) -> None:
    with pytest.raises(InputError, match="systems= is missing"):
        bench.main(["seeds=0"])


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--help"], 0, "usage: dashred bench systems=SYSTEM"),
        (["systems=rde", "twins=a,zz"], 2, "choose from: a, b, c, null"),
    ],
)
def test_the_command_answers_within_two_seconds(words: list[str], code: int, says: str) -> None:
    seconds = []
    # The best of several: other work on this machine is not what is measured.
    for _ in range(5):
        began = time.perf_counter()
        ended = subprocess.run(
            [sys.executable, "-m", "dashred", "bench", *words],
            cwd=CHECKOUT,
            capture_output=True,
            text=True,
        )
        seconds.append(time.perf_counter() - began)
        assert ended.returncode == code, ended.stderr
        assert says in (ended.stderr if code else ended.stdout)
        if seconds[-1] < 2:
            break
    assert min(seconds) < 2


def rows_of(*words: str) -> list[Row]:
    return plan(read_words(["systems=rde", "output=/nowhere", *words]))


def test_the_twins_of_a_bench_are_those_that_start_from_the_simulators_start() -> None:
    assert [row.twin for row in rows_of()] == ["a", "b", "c", "null"]
    assert [row.null for row in rows_of("twins=null,g,a")] == [True, True, False]
    both = plan(read_words(["systems=rde,pendulum", "twins=a,null"]))
    assert [row.name for row in both] == ["rde", "rde", "pendulum", "pendulum"]
    assert {row.store[1] for row in both} == {"bench"}


def test_other_values_of_parameters_are_a_law_and_no_null() -> None:
    """A fault and a far start hide something, too, but leave the simulator's law right."""
    rows = plan(read_words(["systems=heat,rlc,fhn", "output=/nowhere"]))
    hides = {(row.name, row.twin): (row.null, row.law) for row in rows}
    law, other, nothing = (False, True), (False, False), (True, False)
    assert [hides["heat", twin] for twin in ("a", "b", "null")] == [law, law, nothing]
    assert [hides["rlc", twin] for twin in ("a", "b", "c")] == [law] * 3
    assert [hides["fhn", twin] for twin in "efghi"] == [law, other, law, other, other]


def test_a_kept_row_is_told_by_the_plan(stub: Stub) -> None:
    """Rows of an earlier version say that a parameter's twin hides nothing."""
    assert stub.bench("twins=a") == 0
    [file] = stub.output.glob("quick/*/row.json")
    kept = json.loads(file.read_text())
    kept.pop("law", None)
    file.write_text(json.dumps(kept | {"null": True}))
    assert stub.bench("twins=a") == 0
    [row] = stub.table()["rows"]
    assert (row["null"], row["law"]) == (False, True)
    assert len(stub.started()) == 1


def test_rows_that_differ_have_folders_of_their_own() -> None:
    words = ("twins=a,b", "seeds=0-1", "noise=0.05,0.0500001")
    rows = [*rows_of(*words), *rows_of(*words, "threads=3"), *rows_of(*words, "threads=4")]
    assert len({row.folder for row in rows}) == 24
    assert len({json.dumps(row.key) for row in rows}) == 24
    kept = rows_of(*words, "tracking.experiment=other")
    assert [row.folder for row in kept] == [row.folder for row in rows[:8]]
    assert [row.key for row in kept] == [row.key for row in rows[:8]]


def test_sensors_are_a_dimension_like_noise() -> None:
    rows = rows_of("twins=a", "sensors=4,8", "extra=0", "noise=0.01,0.1")
    assert [(row.sensors, row.extra, row.noise) for row in rows] == [
        (4, 0, 0.01),
        (8, 0, 0.01),
        (4, 0, 0.1),
        (8, 0, 0.1),
    ]
    assert "recording.sensors=8" in rows[1].words and "splits.sensors.extra=0" in rows[1].words
    assert str(rows[1]) == "rde a, noise 0.01, 8 sensors, 0 of them extra, seed 0"
    assert len({row.folder for row in [*rows, *rows_of("twins=a", "noise=0.01,0.1")]}) == 6
    both = rows_of("twins=a", "sensors=own,4")
    assert [row.sensors for row in both] == [None, 4]
    assert both[0].folder == rows_of("twins=a")[0].folder


# --- runs ----------------------------------------------------------------------------------------


def test_every_row_is_run_once_with_its_own_words(stub: Stub, capsys: Any) -> None:
    words = ("twins=a,null", "seeds=0-1", "noise=0.05", "jobs=2", "threads=2")
    assert stub.bench(*words) == 0
    ran = stub.started()
    assert {(w["recording.twin"], w["seed"]) for w in ran} == {
        (twin, seed) for twin in ("a", "null") for seed in ("0", "1")
    }
    assert len({w["output"] for w in ran}) == len(ran) == 4
    assert all(w["conf"] == str(stub.quick) and w["threads"] == "2" for w in ran)
    assert {w["tracking.experiment"] for w in ran} == {"bench"}
    assert len({w["tracking.parent"] for w in ran}) == 1
    out = capsys.readouterr().out
    assert "4 rows, 0 of them already finished" in out and "[4/4]" in out
    assert stub.bench(*words) == 0
    assert stub.started() == []
    assert "4 rows, 4 of them already finished" in capsys.readouterr().out
    assert stub.bench(*words[:-1]) == 0
    assert len(stub.started()) == 4


def test_what_failed_is_recorded_and_tried_again(stub: Stub, capsys: Any) -> None:
    words = ("twins=b", "seeds=0-1")
    assert stub.bench(*words) == 1
    assert len(stub.started()) == 2
    failed = stub.table()["rows"][1]
    assert (failed["exit_code"], failed["seed"]) == (2, 1)
    assert failed["problem"] == "error: b: the hidden truth blows up"
    assert "failed with exit code 2: error: b: the hidden truth" in capsys.readouterr().out
    [summary] = stub.table()["summary"]
    assert (summary["rows"], summary["failed"]) == (2, 1)
    (stub.folder / "repaired").touch()
    assert stub.bench(*words) == 0
    assert [w["seed"] for w in stub.started()] == ["1"]
    assert stub.table()["summary"][0]["failed"] == 0


def test_a_run_without_results_is_not_done(stub: Stub, monkeypatch: pytest.MonkeyPatch) -> None:
    command = [sys.executable, "-S", "-c", "pass"]
    monkeypatch.setattr(processes, "train_command", lambda _: command)
    assert stub.bench("twins=a") == 1
    [row] = stub.table()["rows"]
    assert row["exit_code"] == 0 and "has no results" in row["problem"]


@pytest.mark.slow
def test_rows_run_on_a_cluster(stub: Stub) -> None:
    pytest.importorskip("distributed")
    assert stub.bench("twins=a", "seeds=0-1", "cluster=1") == 0
    assert [w["seed"] for w in stub.started()] == ["0", "1"]
    assert [row["exit_code"] for row in stub.table()["rows"]] == [0, 0]
    # They are not run again.
    assert stub.bench("twins=a", "seeds=0-1", "cluster=1") == 0
    assert stub.started() == []


@pytest.mark.parametrize("change", ["config", "law", "half written"])
def test_a_row_of_other_content_is_run_again(stub: Stub, change: str) -> None:
    (stub.folder / "twins").mkdir()
    for name in ("quick.yaml", "twins/quick.yaml"):
        (stub.folder / name).write_text((stub.quick.parent / name).read_text())
    stub.quick = stub.folder / "quick.yaml"
    twins = stub.folder / "twins" / "quick.yaml"
    assert stub.bench("twins=a") == stub.bench("twins=a") == 0
    assert len(stub.started()) == 1
    if change == "config":
        stub.quick.write_text(stub.quick.read_text().replace("nu: 0.2", "nu: 0.21"))
    elif change == "law":
        twins.write_text(twins.read_text().replace("term: u,", "term: u**2,"))
    else:
        [row] = stub.output.glob("quick/*/row.json")
        row.write_bytes(row.read_bytes()[:40])
    assert stub.bench("twins=a") == 0
    assert len(stub.started()) == 1


def test_all_runs_of_a_folder_are_below_one_run_of_mlflow(stub: Stub) -> None:
    assert stub.bench("twins=a", "tracking.experiment=nested") == 0
    assert stub.bench("twins=a", "seeds=0-1", "tracking.experiment=nested") == 0
    [parent] = {words["tracking.parent"] for words in stub.started()}
    with sqlite3.connect(stub.root / "mlflow.db") as database:
        runs = database.execute(
            "select runs.name, status from runs join experiments using (experiment_id) "
            "where experiments.name = 'nested'"
        ).fetchall()
        query = "select key, value from latest_metrics where run_uuid = ?"
        logged = dict(database.execute(query, [parent]).fetchall())
    database.close()
    assert runs == [("bench quick", "FINISHED")]
    assert logged["quick/noise 0.05/rows"] == 2
    assert logged["quick/noise 0.05/coefficient_error/worst"] == pytest.approx(0.1)
    filed = stub.root / "artifacts" / parent / "artifacts" / "table.md"
    assert filed.read_text() == (stub.output / "table.md").read_text()


def test_two_benches_do_not_share_a_folder(stub: Stub) -> None:
    from filelock import FileLock

    make_output(str(stub.output))
    with (
        FileLock(stub.output / ".bench.lock"),
        pytest.raises(InputError, match="another bench is running"),
    ):
        stub.bench("twins=a")


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_ends_the_runs_and_keeps_what_is_done(stub: Stub, how: int) -> None:
    """The signal comes once the second row and a process below it run."""
    waiter = (
        "import os, pathlib, sys, time\n"
        "while not pathlib.Path(sys.argv[1]).exists(): time.sleep(0.05)\n"
        "os.kill(int(sys.argv[2]), int(sys.argv[3]))"
    )
    seen = stub.folder / "processes"
    words = [str(seen), str(os.getpid()), str(int(how))]
    signaller = subprocess.Popen([sys.executable, "-S", "-c", waiter, *words])
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        stub.bench("twins=b", "seeds=0,9")
    assert signaller.wait() == 0
    assert signal.getsignal(signal.SIGTERM) == before
    leader, below = json.loads(seen.read_text())
    last = time.monotonic() + 10
    while (alive(leader) or alive(below)) and time.monotonic() < last:
        time.sleep(0.05)
    assert not alive(leader) and not alive(below)
    parent = json.loads((stub.output / "bench.json").read_text())["run"]
    with sqlite3.connect(stub.root / "mlflow.db") as database:
        query = "select status from runs where run_uuid = ?"
        [(status,)] = database.execute(query, [parent]).fetchall()
    database.close()
    assert status == "KILLED"
    assert len(stub.started()) == 2
    assert stub.bench("twins=b", "seeds=0") == 0
    assert stub.started() == []


# --- numbers -------------------------------------------------------------------------------------


def record(twin: str = "a", **more: Any) -> dict[str, Any]:
    """Return the record of a row that went well."""
    term = {"equation": "u", "term": "u**3", "coefficient": -0.025, "std": 0.0004, "region": None}
    ratios = {
        "corrected/simulation_same_start": 0.1,
        "corrected/simulation_refit": 0.2,
        "corrected_shred/dashred": 0.5,
    }
    return {
        "system": "rde",
        "twin": twin,
        "noise": 0.05,
        "seed": 0,
        "null": twin == "null",
        "law": twin != "null",
        "exit_code": 0,
        "problem": None,
        "verdict": "missing-term",
        "flagged": False,
        "terms": [term],
        "exact_support": True,
        "coefficient_error": 0.01,
        "field_rmse": {"dashred": 0.2, "corrected": 0.03},
        "forecast": {"corrected": 0.05},
        "ratios": ratios,
        "seconds": {"in all": 50.0},
        "git_commit": "0123abc",
    } | more


SOME = [
    record(coefficient_error=0.02, seconds={"in all": 70.0}),
    record(coefficient_error=0.06),
    record(coefficient_error=0.03, verdict="ambiguous", flagged=True),
    record(exact_support=False, coefficient_error=None),
    record(exact_support=False, coefficient_error=None, verdict="not-converged", flagged=True),
    record(exact_support=None, coefficient_error=None, verdict="unresolved-numerics", flagged=True),
    record("null", coefficient_error=0.0, terms=[], ratios=dict.fromkeys(record()["ratios"], 1.0)),
    {**record(), "problem": "exit code -9", "exit_code": -9},
    record(noise=0.01),
]


def test_the_summary_counts_what_was_found_and_what_was_claimed() -> None:
    first, second = summarise(SOME)
    counts = {key: value for key, value in first.items() if isinstance(value, int)}
    assert counts == {
        "rows": 8,
        "failed": 1,
        "exact": 4,
        "exact_unflagged": 3,
        "wrong_unflagged": 1,
        "right_flagged": 1,
        "not_converged": 1,
        "unanswered": 1,
    }
    assert first["coefficient_error"] == {"median": 0.03, "worst": 0.06}
    assert first["ratios"]["corrected/simulation_refit"] == {"median": 0.2, "worst": 0.2}
    assert first["seconds"] == {"median": 50.0, "worst": 70.0}
    assert (second["noise"], second["rows"], second["exact"]) == (0.01, 1, 1)
    metrics = as_metrics([first, second])
    assert metrics["rde/noise 0.05/wrong_unflagged"] == 1
    assert metrics["rde/noise 0.01/ratios/corrected over simulation_refit/worst"] == 0.2
    nothing = summarise([record(exact_support=None, coefficient_error=None)])
    assert "rde/noise 0.05/coefficient_error/median" not in as_metrics(nothing)


def test_a_row_reads_in_one_line() -> None:
    line = finished_line(record())
    assert line == "missing-term  u: -0.025 ± 0.0004 · u**3  exact within 1 %  RMSE × 0.2"
    [cells] = rows_grid([record()]).lines
    assert cells[:8] == [
        "rde",
        "a",
        "0.05",
        "",
        "0",
        "missing-term",
        "u: -0.025 ± 0.0004 · u**3",
        "yes",
    ]
    [cells] = rows_grid([record() | {"sensors": 8, "extra": 2}]).lines
    assert cells[3] == "8 (2 extra)"
    parameter = {"equation": None, "term": "nu", "parameter": "nu", "from": 0.035, "to": 0.05}
    parameter |= {"std": None, "region": None}
    assert "nu: 0.035 → 0.05  not" in finished_line(
        record(terms=[parameter], exact_support=False, coefficient_error=None)
    )
    assert "nothing  exact" in finished_line(record("null", terms=[], coefficient_error=0.0))


def test_the_page_has_as_many_cells_in_every_line() -> None:
    page = to_markdown([rows_grid(SOME)], notes(SOME))
    lines = [line.replace("\\|", "") for line in page.splitlines() if line.startswith("|")]
    assert len(lines) == 2 + len(SOME)
    assert len({line.count("|") for line in lines}) == 1
    assert "u\\*\\*3" in page


def test_rows_of_several_commits_are_pointed_out() -> None:
    assert not any("Warning" in note for note in notes(SOME))
    mixed = " ".join(notes([*SOME, record(git_commit="89ab+")]))
    assert "Warning: these rows were run by 2 versions of the code: 0123abc, 89ab+" in mixed
    assert "uncommitted" in mixed
