"""Tangents of a step that a program itself offers."""
