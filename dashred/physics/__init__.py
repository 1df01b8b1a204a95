"""Equations, spatial operators, integrators and term libraries; independent of sensors."""
