"""Results of the paper (Bao & Kutz 2025) and of running its public code."""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """One system of the paper.

    Attributes:
        hidden: terms that the simulation lacks.
        found: result of the latent regression.
        gain: factor of error reduction.
    """

    hidden: str
    found: str
    gain: str


PAPER = {
    "ks2d": Claim("-(v·∇)u + γu", "u, ∇u and a spurious ∇³u", "~10× by t = 20; its code: 1.3×"),
    "kolmogorov": Claim("-αω", "ω and a spurious ω∇²ω", "poor before t = 20"),
    "gray_scott": Claim("-αV², -βU²V", "V², spurious UV, V³; U²V, spurious V³", ""),
    "rde": Claim("μ(u - u³), -μu, gain depletion", "u, u³, spurious λ²u; u", "about 10×"),
    "pendulum": Claim("-d/(ml²) ω", "ω", "matches"),
    "mass_spring": Claim("damping; mass", "", "eigenspace preserved"),
    "rlc": Claim("resistance; inductance, capacitance", "", "eigenspace preserved"),
    "wave": Claim("damping; density, tension", "", "eigenspace preserved"),
    "heat": Claim("L'u, linear", "closed form", ""),
    "ks1d": Claim("-μu", "u and u² in one latent, nothing in seven (the code)", "the code: 1.8×"),
}
