"""Stages that fit a law to the recording."""
