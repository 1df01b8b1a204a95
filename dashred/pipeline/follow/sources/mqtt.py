"""Messages of an MQTT topic, as JSON."""

from __future__ import annotations

import os
import queue
import time
from typing import Any

from dashred.core.errors import InputError
from dashred.pipeline.follow.remarks import Remarks
from dashred.pipeline.follow.sources.messages import Message, parse_json

PORT, CONNECT_SECONDS = 1883, 10.0
USER, PASSWORD = "DASHRED_MQTT_USER", "DASHRED_MQTT_PASSWORD"


class MqttTopic:
    """A subscription. A lost connection is made again.

    Args:
        host: of the broker.
        port: of the broker.
        topic: of the messages; ``+`` and ``#`` are wildcards.
        place: what messages call the source.
        remarks: told of lost connections.

    Raises:
        InputError: the broker does not answer or refuses the connection.
    """

    def __init__(self, host: str, port: int, topic: str, place: str, remarks: Remarks) -> None:
        from paho.mqtt.client import Client
        from paho.mqtt.enums import CallbackAPIVersion

        self.ended = False
        self._place, self._remarks, self._topic = place, remarks, topic
        self._payloads: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._refusal: str | None = None
        self._is_subscribed = False
        self._client = Client(CallbackAPIVersion.VERSION2)
        if user := os.environ.get(USER):
            self._client.username_pw_set(user, os.environ.get(PASSWORD))
        self._client.on_connect = self._on_connect
        self._client.on_subscribe = self._on_subscribe
        self._client.on_disconnect = self._on_disconnect
        self._client.on_message = self._on_message
        try:
            self._client.connect(host, port, keepalive=30)
        except OSError as error:
            raise self._no_broker(str(error.strerror or error)) from None
        self._client.loop_start()
        end = time.monotonic() + CONNECT_SECONDS
        while not self._is_subscribed and self._refusal is None and time.monotonic() < end:
            time.sleep(0.01)
        if not self._is_subscribed:
            self.close()
            raise self._no_broker(self._refusal or "it does not answer")

    def _no_broker(self, why: str) -> InputError:
        hint = f"is the broker running? A user and a password are read from {USER} and {PASSWORD}"
        return InputError(f"the MQTT broker cannot be used: {why}", where=self._place, hint=hint)

    def _on_connect(self, client: Any, data: Any, flags: Any, reason: Any, more: Any) -> None:
        if reason.is_failure:
            self._refusal = str(reason)
        else:
            client.subscribe(self._topic)

    def _on_subscribe(self, client: Any, data: Any, number: Any, reasons: Any, more: Any) -> None:
        if any(reason.is_failure for reason in reasons):
            self._refusal = f"the topic is refused: {reasons[0]}"
        else:
            self._is_subscribed = True

    def _on_disconnect(self, client: Any, data: Any, flags: Any, reason: Any, more: Any) -> None:
        if reason.is_failure and self._is_subscribed:
            self._remarks.once(
                "connection", f"{self._place}: the connection is lost ({reason}); it is made again"
            )

    def _on_message(self, client: Any, data: Any, message: Any) -> None:
        self._payloads.put(message.payload)

    def read(self, timeout: float) -> list[Message]:
        """Return the messages that have arrived."""
        payloads = []
        try:
            payloads.append(self._payloads.get(timeout=timeout))
            while True:
                payloads.append(self._payloads.get_nowait())
        except queue.Empty:
            pass
        messages = [parse_json(each, self._place, self._remarks) for each in payloads]
        return [message for message in messages if message is not None]

    def close(self) -> None:
        """End the subscription."""
        self._client.disconnect()
        self._client.loop_stop()
