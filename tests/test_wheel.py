"""The wheel: installed into an empty environment, it works away from the checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path
from sysconfig import get_path

import pytest

from tests.conftest import CHECKOUT, QUICK, TWINS
from tests.end_to_end.test_bad_input import SENSORS, csv_text

Ended = subprocess.CompletedProcess[str]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build without the network: what builds it is installed."""
    folder = tmp_path_factory.mktemp("wheel")
    words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", f"--wheel-dir={folder}"]
    pip(*words, str(CHECKOUT))
    [path] = folder.glob("dashred-*.whl")
    return path


def pip(*words: str) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", *words]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr


class Elsewhere:
    """A folder of a stranger's repository, with an environment of its own."""

    def __init__(self, folder: Path, wheel: Path) -> None:
        """Install the wheel; its dependencies are those of the tests."""
        self.folder, self.bin = folder, folder / ".venv" / "bin"
        subprocess.run(
            [sys.executable, "-m", "venv", "--without-pip", folder / ".venv"], check=True
        )
        [packages] = (folder / ".venv" / "lib").glob("*/site-packages")
        # A path in a .pth file: no .pth file there, such as a checkout's, is read.
        (packages / "dependencies.pth").write_text(get_path("purelib") + "\n")
        python = str(self.bin / "python")
        pip("--python", python, "install", "--quiet", "--no-deps", "--no-index", str(wheel))
        identity = ["-c", "user.name=me", "-c", "user.email=me@example.org"]
        for words in (["init", "-q"], [*identity, "commit", "-q", "--allow-empty", "-m", "theirs"]):
            subprocess.run(["git", *words], cwd=folder, check=True)

    def run(self, program: str, *words: str) -> Ended:
        """Run a program of the environment in the folder."""
        surroundings = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
        return subprocess.run(
            [self.bin / program, *words],
            cwd=self.folder,
            env=surroundings | {"NO_COLOR": "1", "COLUMNS": "200"},
            capture_output=True,
            text=True,
        )


@pytest.fixture(scope="module")
def elsewhere(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Elsewhere:
    return Elsewhere(tmp_path_factory.mktemp("elsewhere"), wheel)


@pytest.mark.slow
def test_it_holds_the_packages_the_systems_and_no_truth(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    systems = {path.name for path in (CHECKOUT / "conf").glob("*.yaml")}
    assert {name for name in names if name.endswith(".yaml")} == {
        f"dashred/conf/{name}" for name in systems
    }
    assert {f"{name}/py.typed" for name in ("dashred", "datamodules", "callbacks")} <= set(names)
    assert any(name.endswith("licenses/LICENSE") for name in names)
    tops = {name.split("/")[0] for name in names if ".dist-info" not in name}
    assert tops == {"dashred", "datamodules", "callbacks"}
    code = {
        str(path.relative_to(CHECKOUT)) for top in tops for path in CHECKOUT.glob(f"{top}/**/*.py")
    }
    assert {name for name in names if name.endswith(".py")} == code


@pytest.mark.slow
def test_the_commands_answer(elsewhere: Elsewhere) -> None:
    ended = elsewhere.run("dashred", "--help")
    assert ended.returncode == 0 and ended.stdout.startswith("usage: dashred COMMAND")
    ended = elsewhere.run("python", "-m", "dashred.train", "--help")
    assert ended.returncode == 0 and "bundled system (fhn, " in ended.stdout
    code = "import dashred, sys; print(dashred.__file__)"
    ended = elsewhere.run("python", "-c", code)
    assert Path(ended.stdout.strip()).is_relative_to(elsewhere.folder / ".venv")
    ended = elsewhere.run("dashred", "check", "conf=rde")
    assert ended.returncode == 0, ended.stderr
    assert not (elsewhere.folder / "mlruns").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["train", "conf=rde"],
        ["bench", "systems=rde"],
        ["compare", "systems=rde,fhn"],
        ["record", "conf=rde", "twin=a", "output=recorded"],
        ["prove", "cases=1", "draw=test"],
    ],
)
def test_what_needs_a_checkout_says_so(elsewhere: Elsewhere, words: list[str]) -> None:
    ended = elsewhere.run("dashred", *words)
    assert ended.returncode == 2 and "in a checkout of dashred" in ended.stderr, ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (elsewhere.folder / "recorded").exists()


@pytest.mark.slow
def test_a_recording_is_analysed_where_one_stands(elsewhere: Elsewhere) -> None:
    folder = elsewhere.folder
    (folder / "mine.yaml").write_text(QUICK)
    (folder / "sensors.csv").write_text(SENSORS)
    (folder / "mine.csv").write_text(csv_text())
    words = ["conf=mine.yaml", "recording.path=mine.csv", "recording.sensors=sensors.csv"]
    ended = elsewhere.run("dashred", "train", *words, "output=found")
    assert ended.returncode == 0, ended.stderr
    assert (folder / "found" / "report.html").is_file()
    assert (folder / "mlruns" / "mlflow.db").is_file()
    assert json.loads((folder / "found" / "run.json").read_text())["git_commit"] == "unknown"
    # A user's own twins lie beside a user's own configuration.
    (folder / "twins").mkdir()
    (folder / "twins" / "mine.yaml").write_text(TWINS)
    ended = elsewhere.run("dashred", "record", "conf=mine.yaml", "twin=b", "output=recorded")
    assert ended.returncode == 0, ended.stderr
    assert (folder / "recorded" / "sealed.nc").is_file()
