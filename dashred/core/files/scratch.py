"""A folder for arrays that do not fit into memory, during one run."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from dashred.core.errors import InputError
from dashred.core.job_control import lock_folder
from dashred.core.stated.memory import memory_text

# Space that is left free on the disk.
MARGIN = 2**28


class Scratch:
    """A folder that is created when it is first used, and removed at the end of a run.

    It stays where the run is killed or interrupted with Ctrl-C, so that the next run with the same
    input continues what is in it.

    Args:
        root: the folder; another run must not use it.
        identity: returns a text that differs if the input or the code of a run differs.
    """

    def __init__(self, root: Path, identity: Callable[[], str]) -> None:
        self.root, self.identity = root, identity
        self._lock = ExitStack()
        self._is_used = False

    def folder(self, name: str) -> Path:
        """Return the path of a folder in it.

        Raises:
            InputError: the folder cannot be created, or another run uses it.
        """
        if not self._is_used:
            try:
                self.root.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(
                    f"this folder cannot be created: {error.strerror}",
                    where=str(self.root),
                    hint="choose another folder: output=DIR",
                ) from None
            self._lock.enter_context(lock_folder(self.root, "analysis"))
            self._is_used = True
        return self.root / name

    def check_space(self, size: int) -> None:
        """Check that the disk has space for so many bytes, or for the rest of them.

        Raises:
            InputError: it has not.
        """
        existing = next(each for each in (self.root, *self.root.parents) if each.exists())
        files = (path for path in self.root.rglob("*") if path.is_file())
        written = sum(path.stat().st_size for path in files)
        free = shutil.disk_usage(existing).free
        if free + written < size + MARGIN:
            raise InputError(
                f"the ensembles take {memory_text(size)} on disk, but only {memory_text(free)} are "
                "free there",
                where=str(self.root),
                hint="write elsewhere, output=DIR; or choose fewer simulation.members, or a larger "
                "simulation.memory",
            )

    @contextmanager
    def removed_at_the_end(self) -> Iterator[None]:
        """Remove the folder at the end, unless the run is interrupted."""
        try:
            yield
        except Exception:
            self.remove()
            raise
        else:
            self.remove()
        finally:
            self._lock.close()

    def remove(self) -> None:
        """Remove the folder, if this run has used it."""
        if self._is_used:
            shutil.rmtree(self.root, ignore_errors=True)
            self._is_used = False
