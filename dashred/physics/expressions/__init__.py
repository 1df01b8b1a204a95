"""The equation language: parser, algebra, derivatives."""
