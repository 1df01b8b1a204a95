"""Sources of a stream: a growing file, standard input, an MQTT topic and a WebSocket."""
