"""Write the FMU of a corrected model: the original with another library beside its own.

The new library loads the original one and adds the law to the derivatives that it returns. For
co-simulation it steps the law and the original one in turn (Strang splitting).
"""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from dashred.core.files.atomic import atomic_file
from dashred.physics.external.adapters.fmu.corrected.library import (
    Correction,
    NotPossibleError,
    compile_library,
    starts,
    write_source,
)
from dashred.physics.external.adapters.fmu.corrected.model_description import corrected_description
from dashred.physics.external.adapters.fmu.description import MODEL_EXCHANGE, Description

SOURCE = "documentation/corrected.c"
XML = "modelDescription.xml"


def write_fmu(path: Path, description: Description, correction: Correction, told: str) -> None:
    """Write the FMU atomically; the same arguments give the same contents.

    Args:
        path: of the new FMU.
        description: of the original.
        correction: what is added to it.
        told: what the new model description says of the law.

    Raises:
        NotPossibleError: there is no such FMU, or no compiler.
    """
    import fmpy

    if fmpy.platform.startswith("win"):
        raise NotPossibleError("it is written on Linux and macOS only")
    about = description.description
    interface = about.modelExchange if description.kind == MODEL_EXCHANGE else about.coSimulation
    identifier = interface.modelIdentifier
    suffix = fmpy.sharedLibraryExtension
    with (
        ZipFile(description.path) as original,
        TemporaryDirectory(prefix="dashred-fmu-") as scratch,
    ):
        members = original.namelist()
        folder = _binaries(members, f"{identifier}{suffix}")
        new = re.sub(r"\W", "_", f"{identifier}_corrected", flags=re.ASCII)
        words = repr((correction, told, about.guid, [original.getinfo(m).CRC for m in members]))
        token = "{" + sha256(words.encode()).hexdigest()[:32] + "}"
        tokens = token, str(about.guid)
        source, library = Path(scratch) / "corrected.c", Path(scratch) / f"{new}{suffix}"
        source.write_text(
            write_source(description, correction, tokens, f"{identifier}{suffix}"), encoding="utf-8"
        )
        compile_library(source, library)
        xml = corrected_description(
            original.read(XML), description, new, token, told, starts(description, correction)
        )
        added = {
            XML: xml,
            SOURCE: source.read_bytes(),
            f"{folder}/{new}{suffix}": library.read_bytes(),
        }
        with atomic_file(path) as partial, ZipFile(partial, "w", ZIP_DEFLATED) as archive:
            for name in members:
                if _is_kept(name, folder) and name not in added:
                    _add(archive, name, original.read(name))
            for name, content in added.items():
                _add(archive, name, content)


def _binaries(members: list[str], library: str) -> str:
    """Return the folder of the library for this platform."""
    import fmpy

    for platform in (fmpy.platform, fmpy.platform_tuple):
        if f"binaries/{platform}/{library}" in members:
            return f"binaries/{platform}"
    raise NotPossibleError(f"the FMU has no library {library} for {fmpy.platform}")


def _is_kept(name: str, folder: str) -> bool:
    """Whether a file belongs to the new FMU: binaries for other platforms do not know the law."""
    if name.endswith("/") or name.startswith("sources/"):
        return False
    return not name.startswith("binaries/") or name.startswith(f"{folder}/")


def _add(archive: ZipFile, name: str, content: bytes) -> None:
    # Without the time, so that equal laws give equal files.
    member = ZipInfo(name)
    member.compress_type, member.external_attr = ZIP_DEFLATED, 0o755 << 16
    archive.writestr(member, content)
