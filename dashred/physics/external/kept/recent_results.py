"""Results of the last calls, in memory."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from hashlib import blake2b

import numpy as np

from dashred.physics.external.state_batch import Array, StateBatch

# When the results take more space, in bytes, the oldest are forgotten.
MOST_BYTES = 2**28
KEY_BYTES = 16
# What Python takes for an entry beside the numbers: far more than those of a small state.
ENTRY_BYTES = 330


class RecentResults:
    """The last results of one program, found by the state, t, dt, inputs and parameters.

    A fit begins where another one ended, and a law is simulated again where it is compared: about
    a fifth of the calls of an analysis.
    """

    def __init__(self) -> None:
        self._results: OrderedDict[bytes, Array] = OrderedDict()
        self._bytes = 0

    def keys(self, batch: StateBatch) -> list[bytes]:
        """Return the key of each state of a batch."""
        parameters = repr(sorted(batch.parameters.items())).encode()
        inputs = [values for _, values in sorted(batch.inputs.items())]
        clocks = np.stack([batch.t, batch.dt, *inputs], axis=1)
        return [
            blake2b(parameters + clock.tobytes() + state.tobytes(), digest_size=KEY_BYTES).digest()
            for clock, state in zip(clocks, batch.states, strict=True)
        ]

    def find(self, keys: Sequence[bytes]) -> list[Array | None]:
        """Return the result ``(field, *grid)`` of each key, or None."""
        return [self._results.get(key) for key in keys]

    def keep(self, keys: Sequence[bytes], results: Array) -> None:
        """Keep the results ``(batch, field, *grid)``, also those of states that failed."""
        for key, result in zip(keys, results, strict=True):
            if key not in self._results:
                self._results[key] = result.copy()
                self._bytes += ENTRY_BYTES + result.nbytes
        while self._bytes > MOST_BYTES:
            _, result = self._results.popitem(last=False)
            self._bytes -= ENTRY_BYTES + result.nbytes
