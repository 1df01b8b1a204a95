"""Time stepping: one integrator a file, each advancing a batch of states."""

METHODS = {
    "spectral": ("etdrk4",),
    "finite-difference": ("ssprk3",),
    "ode": ("rk4", "dopri5", "dopri8", "bosh3", "midpoint", "euler"),
}
"""Methods that fit each kind of space; the first is the default."""
