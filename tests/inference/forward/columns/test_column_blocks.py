"""The columns of a large Jacobian are the same, bit for bit, wherever they are computed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.core.budget import Deadline, OutOfTimeError
from dashred.core.cluster.calls import ClusterCalls, cluster_in_use
from dashred.core.work import work_done
from dashred.inference.forward.columns import column_blocks as module
from dashred.inference.forward.columns.tangent_columns import TangentColumns
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.tangents.spectral_columns.threads import columns_together
from tests import waves

# 2048 values of a state: at most 64 columns stand in a block, except in the last one.
TEXT = waves.TEXT.replace("points: 32", "points: 1024").replace("length: 3", "length: 0.3")
TIMES = 0.25 * torch.arange(4, dtype=torch.float64)
VALUES = 2048


@pytest.fixture(scope="module")
def fine(tmp_path_factory: pytest.TempPathFactory) -> waves.Waves:
    """The waves on many points; a start prior of many modes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(waves, "TEXT", TEXT)
        return waves.Waves.declared(tmp_path_factory.mktemp("fine"))


@pytest.fixture
def model(fine: waves.Waves, monkeypatch: pytest.MonkeyPatch) -> ForwardModel:
    """A law of all terms, with a forcing; a Jacobian of any size is divided."""
    monkeypatch.setattr(module, "LARGE", 0)
    found = fine.forward_model(LawBlock([*fine.everything.values()]), TIMES)
    block = ForcingBlock(ForcingBasis.over(fine.system, found.times, 4, 3), fine.size)
    return replace(found, forcing=block)


def in_two_episodes(model: ForwardModel) -> ForwardModel:
    """Return the model of two episodes, the second of which is shorter."""
    own, sensors = model.start, SensorBlock(model.sensors.operator, 2)
    assert isinstance(own, EpisodeStarts)
    start, simulator = EpisodeStarts(own.models * 2), Simulator([*model.simulator.parts] * 2)
    times = stack_times([TIMES, TIMES[:3]])
    return replace(model, start=start, sensors=sensors, times=times, simulator=simulator)


def jacobian(model: ForwardModel) -> Tensor:
    generator = torch.Generator().manual_seed(3)
    z = 0.3 * torch.randn(model.modes, generator=generator).double()
    count = model.law.count + model.slices.forcing.stop - model.slices.forcing.start
    xi = 0.01 * torch.randn(count, generator=generator).double()
    with torch.no_grad():
        return model._columns(z, xi)


@pytest.fixture(params=[1, 2, 3])
def calls(request: pytest.FixtureRequest, two_workers: ClusterCalls) -> ClusterCalls:
    """So many calls at once."""
    return ClusterCalls(two_workers._client, request.param)


def there(model: ForwardModel, calls: ClusterCalls, monkeypatch: pytest.MonkeyPatch) -> Tensor:
    """Return the Jacobian that workers compute."""
    with monkeypatch.context() as patch:
        patch.setattr(module, "cluster_in_use", lambda: calls)
        return jacobian(model)


def test_workers_return_the_bits_of_this_machine(model, calls, monkeypatch) -> None:
    expected, before = jacobian(model), work_done()
    found = there(model, calls, monkeypatch)
    after = work_done()
    assert torch.equal(found, expected)
    assert found.dtype == expected.dtype and bool(found.isfinite().all())
    jacobian(model)
    # Nothing is integrated twice.
    there_steps, here_steps = (
        late["column steps"] - early["column steps"]
        for early, late in ((before, after), (after, work_done()))
    )
    assert there_steps == here_steps > 0


def test_workers_return_the_bits_of_compiled_trajectories(model, calls, monkeypatch) -> None:
    z, xi = torch.zeros(1, model.modes).double(), torch.zeros(1, model.slices.forcing.stop).double()
    model.readings(z, xi)
    assert model.simulator.has_compiled(model.law.candidates)
    assert torch.equal(there(model, calls, monkeypatch), jacobian(model))


def test_workers_return_the_bits_of_episodes(model, calls, monkeypatch) -> None:
    two = in_two_episodes(model)
    assert torch.equal(there(two, calls, monkeypatch), jacobian(two))


def test_the_deadline_holds_on_workers(model, calls, monkeypatch) -> None:
    z, xi = torch.zeros(model.modes).double(), torch.zeros(model.slices.forcing.stop).double()
    monkeypatch.setattr(module, "cluster_in_use", lambda: calls)
    with torch.no_grad(), pytest.raises(OutOfTimeError):
        model._columns(z, xi, Deadline(0.0))


def test_blocks_depend_on_the_problem_alone(model, monkeypatch) -> None:
    seen: list[list[slice]] = []
    compute = TangentColumns.at

    def spy(columns, point, blocks, deadline):
        seen.append(blocks)
        return compute(columns, point, blocks, deadline)

    monkeypatch.setattr(TangentColumns, "at", spy)
    columns = jacobian(model).shape[-1]
    group = columns_together(columns, VALUES)
    size = group * (module.BLOCK_POINTS // (group * VALUES))
    [blocks] = seen
    assert [b.start for b in blocks] == [size * i for i in range(columns // size)]
    assert [b.stop for b in blocks] == [*(b.start for b in blocks[1:]), columns]
    monkeypatch.undo()
    assert jacobian(model).shape[-1] == columns


def test_a_small_jacobian_is_one_block(fine, monkeypatch) -> None:
    monkeypatch.setattr(TangentColumns, "at", lambda *given: given[2])
    model = fine.forward_model(LawBlock([*fine.everything.values()]), TIMES)
    columns = module.compute_columns(_columns_of(model), None)  # type: ignore[arg-type]
    assert columns == [slice(0, model.modes + model.law.count)]


def _columns_of(model: ForwardModel) -> TangentColumns:
    return TangentColumns(model.simulator, model.start, model.law, model.sensors, model.times, None)


def test_a_fit_without_a_cluster_does_not_import_dask(tmp_path: Path) -> None:
    assert cluster_in_use() is None
    code = (
        "import sys, torch\nfrom pathlib import Path\nfrom tests.waves import Waves, LawBlock\n"
        "import dashred.pipeline.equations\n"
        f"model = Waves.declared(Path({str(tmp_path)!r})).forward_model(LawBlock([]))\n"
        "model._columns(torch.zeros(model.modes).double(), torch.zeros(0).double())\n"
        "print(sorted({'dask', 'distributed'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().splitlines()[-1] == "[]"
