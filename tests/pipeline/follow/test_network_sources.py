"""MQTT and WebSocket, with a real broker and a real server on this machine."""

from __future__ import annotations

import importlib.util
import json
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message, Source
from dashred.pipeline.follow.sources.open_source import check_source, open_source

MESSAGES = [{"time": 0.1 * i, "s1": float(i)} for i in range(5)]
SECONDS = 30.0
AMQTT = """\
listeners: {default: {type: tcp, bind: "127.0.0.1:PORT"}}
plugins:
  amqtt.plugins.authentication.AnonymousAuthPlugin: {allow_anonymous: true}
"""


def free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def received(source: Source, count: int) -> list[Message]:
    """Read until so many messages have come, or the stream has ended."""
    found: list[Message] = []
    end = time.monotonic() + SECONDS
    while len(found) < count and not source.ended and time.monotonic() < end:
        found += source.read(0.1)
    return found


@pytest.fixture(scope="module")
def broker(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """The port of a broker: Debian's mosquitto, or amqtt."""
    pytest.importorskip("paho.mqtt")
    port, folder = free_port(), tmp_path_factory.mktemp("broker")
    if found := shutil.which("mosquitto"):
        config = folder / "mosquitto.conf"
        config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\n")
        command = [found, "-c", str(config)]
    elif importlib.util.find_spec("amqtt"):
        config = folder / "broker.yaml"
        config.write_text(AMQTT.replace("PORT", str(port)))
        command = [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(config)]
    else:
        pytest.skip("neither mosquitto nor amqtt is installed")
    with (
        (folder / "log").open("wb") as log,
        subprocess.Popen(command, stdout=log, stderr=log) as process,
    ):
        try:
            end = time.monotonic() + SECONDS
            while time.monotonic() < end:
                with socket.socket() as client:
                    if client.connect_ex(("127.0.0.1", port)) == 0:
                        break
                time.sleep(0.1)
            yield port
        finally:
            process.terminate()


def test_messages_of_a_topic_arrive(broker: int) -> None:
    from paho.mqtt.client import Client
    from paho.mqtt.enums import CallbackAPIVersion

    said: list[str] = []
    address = f"mqtt://127.0.0.1:{broker}/rig/#"
    check_source(address)
    source = open_source(address, Remarks(said.append))
    try:
        client = Client(CallbackAPIVersion.VERSION2)
        client.connect("127.0.0.1", broker)
        client.loop_start()
        sent = [client.publish("rig/sensors", json.dumps(each), qos=1) for each in MESSAGES]
        sent.append(client.publish("rig/sensors", b"\xff no JSON", qos=1))
        for each in sent:
            each.wait_for_publish(SECONDS)
        found = received(source, len(MESSAGES))
        source.read(0.5)
        client.disconnect()
        client.loop_stop()
    finally:
        source.close()
    assert [(m.time, dict(m.readings)) for m in found] == [
        (each["time"], {"s1": each["s1"]}) for each in MESSAGES
    ]
    assert len(said) == 1 and "not an object of JSON" in said[0]


def test_a_broker_that_does_not_answer_is_one_message() -> None:
    pytest.importorskip("paho.mqtt")
    with pytest.raises(InputError, match="broker cannot be used"):
        open_source(f"mqtt://127.0.0.1:{free_port()}/rig", Remarks(lambda line: None))


@pytest.fixture
def server() -> Iterator[str]:
    """The address of a server that sends the messages and ends."""
    sync = pytest.importorskip("websockets.sync.server")

    def send(connection: Any) -> None:
        for each in MESSAGES:
            connection.send(json.dumps(each))

    with sync.serve(send, "127.0.0.1", 0) as running:
        thread = Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield f"ws://127.0.0.1:{running.socket.getsockname()[1]}/"
        running.shutdown()
        thread.join(SECONDS)


def test_messages_of_a_websocket_arrive_until_its_end(server: str) -> None:
    check_source(server)
    source = open_source(server, Remarks(lambda line: None))
    found = received(source, len(MESSAGES) + 1)
    source.close()
    assert source.ended
    assert [m.readings["s1"] for m in found] == [each["s1"] for each in MESSAGES]


def test_a_server_that_does_not_answer_is_one_message() -> None:
    pytest.importorskip("websockets")
    with pytest.raises(InputError, match="WebSocket cannot be opened"):
        open_source(f"ws://127.0.0.1:{free_port()}/", Remarks(lambda line: None))


@pytest.mark.parametrize(
    ("address", "what"),
    [
        ("nowhere.csv", "no such file"),
        ("http://127.0.0.1/x", "no source of the kind"),
        ("mqtt://127.0.0.1:1883", "not a complete address"),
        ("mqtt://u:p@127.0.0.1/x", "password"),
        ("ws://:80/", "not a complete address"),
    ],
)
def test_wrong_addresses_are_told(address: str, what: str, tmp_path: Path) -> None:
    pytest.importorskip("paho.mqtt")
    pytest.importorskip("websockets")
    with pytest.raises(InputError, match=what):
        check_source(address)


def test_a_missing_package_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashred.pipeline.follow.sources.open_source.find_spec", lambda name: None)
    with pytest.raises(InputError, match="needs the package websockets"):
        check_source("ws://127.0.0.1:80/")
