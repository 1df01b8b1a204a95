"""Open the source that the command line names."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

from dashred.core.errors import InputError
from dashred.core.files.user_path import user_path
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Source
from dashred.pipeline.follow.sources.mqtt import PORT, MqttTopic
from dashred.pipeline.follow.sources.text_streams import GrowingFile, StandardInput
from dashred.pipeline.follow.sources.websocket import WebSocket

STANDARD_INPUT = "-"
MQTT, WEBSOCKET = ("mqtt",), ("ws", "wss")
# The package of each kind of address.
PACKAGES = {"mqtt": ("paho", "paho-mqtt"), "ws": ("websockets",) * 2, "wss": ("websockets",) * 2}
FORMS = "FILE.csv, - for standard input, mqtt://HOST:PORT/TOPIC or ws://HOST:PORT/PATH"


def check_source(text: str) -> None:
    """Check the address of a source without opening it.

    Raises:
        InputError: it is no address of a known kind, its package is not installed, or there is no
            such file.
    """
    scheme, sign, rest = text.partition("://")
    if not sign:
        if text != STANDARD_INPUT and not Path(user_path(text, "source")).exists():
            raise InputError("there is no such file", where=text, hint=f"give {FORMS}")
        return
    if scheme not in PACKAGES:
        raise InputError(f"there is no source of the kind {scheme!r}", where=text, hint=FORMS)
    module, package = PACKAGES[scheme]
    if find_spec(module) is None:
        what = f"this source needs the package {package}, which is not installed"
        raise InputError(what, where=text, hint="pip install 'dashred[follow]'")
    host, _, topic = rest.partition("/")
    if "@" in host:
        raise InputError("the address must not contain a password", where=scheme, hint=FORMS)
    try:
        is_usable = bool(urlsplit(f"//{host}").hostname) and urlsplit(f"//{host}").port != 0
    except ValueError:
        is_usable = False
    if not is_usable or (scheme in MQTT and not topic):
        raise InputError("this is not a complete address", where=text, hint=FORMS)


def open_source(text: str, remarks: Remarks) -> Source:
    """Open a source whose address was checked.

    Raises:
        InputError: it cannot be opened.
    """
    scheme, sign, rest = text.partition("://")
    if not sign:
        if text == STANDARD_INPUT:
            return StandardInput(remarks)
        return GrowingFile(user_path(text, "source"), remarks)
    if scheme in WEBSOCKET:
        return WebSocket(text, remarks)
    # The signs + and # of a topic have other meanings in the address of a page.
    host, _, topic = rest.partition("/")
    parts = urlsplit(f"//{host}")
    return MqttTopic(str(parts.hostname), parts.port or PORT, topic, text, remarks)
