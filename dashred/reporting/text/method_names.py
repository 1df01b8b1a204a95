"""What every method is called: in keys of figures, in tables, and in the printed summary."""

# Drawn or told as one where the latent transform changed nothing, which is what SHRED reads.
SHRED_UNCHANGED = "shred = dashred"

NAMES = {
    "truth": "truth",
    "recorded": "recorded",
    "snapshots": "nearest snapshots",
    "simulation": "simulation, nominal start",
    "simulation_same_start": "simulation, same start",
    "simulation_refit": "simulation, best start",
    "optimal_interpolation": "optimal interpolation",
    "closed_form": "closed form of linear systems",
    "filter_state": "ensemble Kalman filter",
    "filter_augmented": "ensemble Kalman filter with coefficients",
    "shred_plain": "SHRED, plain",
    "shred": "SHRED, randomised",
    "dashred": "DA-SHRED",
    SHRED_UNCHANGED: "SHRED = DA-SHRED",
    "corrected": "dashred: corrected simulator",
    "corrected_shred": "dashred: corrected SHRED",
}
# The findings' own words for them, of sensors.
NAMES |= {
    "before": NAMES["simulation_same_start"],
    "before_refit": NAMES["simulation_refit"],
    "after": NAMES["corrected"],
}

# What is compared at sensors, in the order in which a reader should meet it.
AT_SENSORS = (
    "snapshots",
    "simulation",
    "before",
    "before_refit",
    "shred_plain",
    "shred",
    "dashred",
    "after",
)


def method_name(method: str) -> str:
    """The method as a reader knows it."""
    return NAMES.get(method, method)
