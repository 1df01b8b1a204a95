"""Time stepping: one integrator a file, each advancing a batch of states."""

METHODS = {
    "spectral": ("etdrk4",),
    "finite-difference": ("ssprk3",),
    "ode": ("dopri5", "dopri8", "bosh3", "rk4", "midpoint", "euler"),
}
"""Methods that fit each kind of space; the first is the default."""
