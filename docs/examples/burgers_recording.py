"""Write a recording of Burgers' equation with drag: ``python burgers_recording.py``."""

import numpy as np

POINTS, NU, DRAG, STEP = 256, 0.05, 0.3, 0.0025
x = 2 * np.pi * np.arange(POINTS) / POINTS
waves = 1j * np.fft.rfftfreq(POINTS, 1 / POINTS)
kept = np.abs(waves) < POINTS / 3


def tendency(u):
    """Return ∂u/∂t."""
    modes, flux = np.fft.rfft(u), kept * np.fft.rfft(u * u / 2)
    return np.fft.irfft(NU * waves**2 * modes - waves * flux, POINTS) - DRAG * u


rng = np.random.default_rng(21)
u = 1 + 0.8 * np.sin(x) + 0.3 * np.cos(2 * x + 0.5)
u += sum(0.04 * rng.normal() * np.cos(k * x + rng.uniform(0, 6.28)) for k in range(1, 5))
states = [u]
for step in range(1, 3201):
    a = tendency(u)
    b = tendency(u + STEP / 2 * a)
    c = tendency(u + STEP / 2 * b)
    d = tendency(u + STEP * c)
    u = u + STEP / 6 * (a + 2 * b + 2 * c + d)
    if step % 40 == 0:
        states.append(u)

places = (np.arange(17) + rng.uniform(-0.3, 0.3, 17)) * 2 * np.pi / 17 % (2 * np.pi)
modes = np.fft.rfft(states, axis=1)
weights = np.full(len(waves), 2.0)
weights[[0, -1]] = 1
clean = np.stack([(modes * weights * np.exp(waves * p)).real.sum(1) / POINTS for p in places], 1)
std = 0.01 * np.std(states)
readings = clean + std * rng.normal(size=clean.shape)
names = [f"S{k}" for k in range(len(places))]
table = np.column_stack([0.1 * np.arange(len(states)), readings])
header = ",".join(["time", *names])
np.savetxt("burgers.csv", table, delimiter=",", header=header, comments="", fmt="%.8g")
with open("sensors.csv", "w") as file:
    print("name,field,x,std", file=file)
    for name, place in zip(names, places, strict=True):
        print(f"{name},u,{place:.6f},{std:.5g}", file=file)
