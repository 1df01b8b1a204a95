"""Recordings as a stranger would bring them."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def swing_csv(folder: Path, header: str = "time,angle,speed") -> Path:
    """Write a swing of period 1 at 500 Hz, 8 periods: ``angle' = speed``."""
    rng = np.random.default_rng(3)
    t = np.arange(4000) * 2e-3
    angle = np.cos(2 * np.pi * t) + 2e-3 * rng.standard_normal(len(t))
    speed = -2 * np.pi * np.sin(2 * np.pi * t) + 1e-2 * rng.standard_normal(len(t))
    rows = [f"{a:.3f},{b:.6f},{c:.6f}" for a, b, c in zip(t, angle, speed, strict=True)]
    path = folder / "swing.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def bar_csv(folder: Path) -> tuple[Path, Path]:
    """Write a cooling bar, ``T = 1 + e^{-t/4} cos(πx/10)``, at 8 places, and their table."""
    rng = np.random.default_rng(4)
    t = np.arange(80) * 0.1
    places = 0.5 + 1.2 * np.arange(8)
    clean = 1 + np.exp(-t[:, None] / 4) * np.cos(np.pi * places / 10)
    noisy = clean + 0.01 * rng.standard_normal(clean.shape)
    names = [f"p{i}" for i in range(len(places))]
    rows = [
        ",".join([f"{now:.1f}", *(f"{v:.5f}" for v in row)])
        for now, row in zip(t, noisy, strict=True)
    ]
    recording, table = folder / "bar.csv", folder / "bar-sensors.csv"
    recording.write_text("\n".join([",".join(["time", *names]), *rows]) + "\n")
    lines = [f"{name},T,{x:.1f},0.01" for name, x in zip(names, places, strict=True)]
    table.write_text("\n".join(["name,field,x,std", *lines]) + "\n")
    return recording, table
