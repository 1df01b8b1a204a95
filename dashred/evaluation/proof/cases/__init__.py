"""The concealed cases of the proof: drawn, recorded, described."""
