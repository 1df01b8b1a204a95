"""What the page of a comparison says of its tables: what is counted, and what each method knows."""

from dashred.evaluation.comparison.ratios import FIELDS, REFERENCE

INTRODUCTION = (
    "Every number here is of twins: a truth that the analysis does not have, run at doubled "
    "resolution from a start of its own, is read by a few noisy sensors; the analysis gets these "
    "readings alone, and its findings are frozen before the seal is opened. The other methods that "
    "read sensors are run after that, in a process that is handed the recording alone; PDE-FIND "
    "runs with the seal open, for it alone is given the whole field. The paper is Bao & Kutz, "
    "*Data assimilation and discrepancy modeling with shallow recurrent decoders* (2025), whose "
    "code trains on the real full field."
)
PAPER_NOTE = (
    "Exact law: of the twins that hide one, those of which the best guess is just that; listed: of "
    "the others, ambiguous ones with the true law among the three that are listed. No law hidden: "
    "twins that hide nothing, or a sensor's fault or a far start, and of them those of which just "
    "that is told. Wrong and unflagged: a wrong verdict that is not ambiguous, not-converged, "
    "outside-library or unresolved-numerics. Rows that failed count, and are not right. Error "
    "falls: the field's RMSE of the simulator as it is over that of the corrected one, the median "
    "over twins that hide a law. Seconds: of the analysis from its first simulation to its report, "
    "learning and figures included, each stage once where an attempt was cut short and gone on "
    "with; starting Python, recording the twin and opening its seal are not. Rows that ran side by "
    "side (jobs=2) took longer than alone. Step: of the corrected SHRED, from a window of readings "
    "to the whole field, on one core. Two of ours are other flows than the paper's, whose figures "
    "measure another thing there: kolmogorov (a box of 2π with sin 4y, not [0, 64]² with sin y), "
    "and ks1d (L = 38 with 64 points, not 32π with 256)."
)
FIELD_NOTE = (
    f"RMSE of the whole field over the fit window, over that of the {FIELDS[REFERENCE]} (the "
    "simulator as it is, begun where the law's fit begins); the median over twins that hide a law, "
    "and seeds. Below 1 is better than the simulation. A method that failed, or whose field is not "
    "finite, is lost and counts as worse than any other. Optimal interpolation, SHRED and the "
    "Kalman filters know, at every time, the readings until then alone (optimal interpolation that "
    "sample alone); DA-SHRED is trained on the window, and the corrected simulator and the closed "
    "form are fitted to all of it."
)
SENSORS_NOTE = (
    "SHRED reads p sensors, assimilation and the law's fit p + q; the ratios are as in the tables "
    "of the field. Corrected –: no law was claimed, and the corrected simulator is the simulation."
)
LAW_NOTE = (
    "Exact: rows in which all true terms were found and no others, of those in which the method "
    "was asked for a law, twins that hide none among them. A method that names no law, since it "
    "failed or did not converge, has missed all terms and is not exact. Error: median over rows of "
    "the worst relative error of the true terms found. Latent SINDy's terms are those with a "
    "coefficient that is not zero; the filter's those that are not zero at 95 % over all terms "
    "together (each at 1 - 0.05/terms). PDE-FIND is given what nobody has, the full field, with "
    "the same noise at every point; its time differences are over the recording's own interval, "
    "which may be long for it."
)
SECONDS_NOTE = (
    "Medians over rows, on the machine that ran them. Of methods that learn from simulations these "
    "are counted. DA-SHRED's and latent SINDy's are one stage's: SHRED, its assimilation and both "
    "algorithms. The corrected simulator's are those of the whole analysis. Not counted: starting "
    "Python, reading the recording, one nominal run for the other methods."
)


def unchanged_note(unchanged: int, rows: int) -> str:
    """Return in how many rows assimilation changed nothing, and why."""
    return (
        f"DA-SHRED is SHRED itself in {unchanged} of {rows} rows: a latent transform is kept only "
        "where validation sensors, which it was not fitted to, confirm a gain "
        "(`assimilation.gain`)."
    )
