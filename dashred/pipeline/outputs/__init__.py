"""Output files of a run: report, figures, fields and corrected configuration."""
