"""Twin experiments: hidden truths, recorded and scored."""
