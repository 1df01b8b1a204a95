"""Equations, spatial operators, integrators, term libraries: knows nothing of sensors."""
