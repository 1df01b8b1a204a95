"""What a proof does, as its page says it."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.evaluation.proof.cases.identifiability import CLEAR
from dashred.evaluation.proof.cases.oracle import DECIDABLE
from dashred.evaluation.proof.cases.systems import SYSTEMS

PROTOCOL = """\
Each case hides something in a system, records it with a few noisy sensors, and asks the tool what
its simulation leaves out. `python -m dashred.evaluation.prove` does all of this and writes this page.

1. **Drawn.** What is hidden follows from one number, {seed}, which comes from {origin}. Laws that
   act everywhere have one to three terms of the analysis's library; one term acts in a region,
   gated by the state, or from an onset on; those *outside* have one that the library lacks, its
   constants drawn, too: most of these forms are among those that the tool tries one step beyond
   its library. Their size is such that the sensors read {effects} times their noise apart from the
   simulation's, rms, or less, where that were more than 0.7 of a trace's std or blew up; of `ks1d`,
   where chaos makes much of little, each term is some 1 to 10 % of the equation's tendency; gated
   ones are of the upper half of these ranges. Other
   cases have a wrong parameter, a faulty sensor (one that the analysis fits), a start outside of
   its prior, numerics that are not resolved (the grid of the simulator, which is the user's to
   give, is too coarse), or nothing at all. *Masked* ones have a law behind a wrong parameter that
   makes up for most of it, or beside a faulty sensor, or below the noise of a single sample: there
   each cause that is named has to be a true one. Sensors, noise ({noises}) and starts are drawn,
   too. The terms and parameters that are drawn are listed in `systems.py`, with what is left out
   because no recording of these sensors tells it from others. Of the laws that act everywhere,
   those that are not {clear:g} ahead of every other law of up to three terms in the score, by
   algebra about the true trajectory before any analysis (`foreseen.py`), are drawn again, three of
   four of them; so are all cases whose simulator does not resolve them to their noise (its own
   numerical error adds more than {decidable:g} to χ²), but for those of numerics: {drawn_again}
   were. A third of the nulls have correlated noise, noise of another
   size than stated, or a sensor 0.25 % of the axis off its place, which may be named.
2. **Sealed.** The truth runs at doubled resolution. The analysis runs in a process of its own, in a
   copy of the package without draw, recorder, scorer and twins. It is handed the recording, in a
   folder with nothing else in it, and a seed that says nothing; while it works, the truth of its
   case is on no disk.
3. **Frozen, opened, scored.** The findings are hashed before the seal is written and opened. A law
   is right in its exact form alone, its window's kind included; a parameter that does the same as
   the true one, and says so, is right, but its value is compared with nothing. A fault that is told
   beside a law has to be a true one. The scorer also fits the true form from the true start, its
   edges as they are: the *oracle*. A case is *decidable* if that form beats the simulation as it
   is, and every rival, by more than 6 in the score that compares laws; the law that was returned
   keeps its coefficients there, and where none was, the simulation as it is stands for it. Rivals
   are those that the analysis found. Seconds are those of the analysis's CPU.

Drawn: {cases} cases, and {nulls} nulls, which are counted apart. Finished: {finished}, in about
{hours:.1f} h of {processes} processes side by side. `docs/draws.md` lists every draw that was
begun, also those that were not finished.{scored}"""


@dataclass(frozen=True)
class ProtocolFacts:
    """How this draw came to be: what no case's record knows.

    Attributes:
        commit: hash of the code under test; None of a draw for practice.
        draw: what the seed of the draw was made of.
        seed: of the draw.
        cases: how many were drawn.
        nulls: how many were drawn apart.
        hours: that all took, on the clock.
        processes: that ran side by side.
        drawn_again: how many cases gave way to others, whose law can be foreseen to be told.
        scored_by: commit that scored the draw again; None where it was scored as it was analysed.
    """

    commit: str | None
    draw: str
    seed: int
    cases: int
    nulls: int
    hours: float
    processes: int
    drawn_again: int
    scored_by: str | None


def protocol(facts: ProtocolFacts, finished: int) -> str:
    """Return the protocol of one draw, of whose cases so many are finished."""
    return PROTOCOL.format(
        **vars(facts),
        finished=finished,
        origin=_origin(facts),
        effects=_effects(),
        noises=_noises(),
        clear=CLEAR,
        decidable=DECIDABLE,
        scored=_scored(facts),
    )


def _origin(facts: ProtocolFacts) -> str:
    if facts.commit is None:
        return f"the text {facts.draw!r}: this is a draw for practice, and not the proof"
    return f"the hash of the commit under test ({facts.commit}): nothing can have been tuned to it"


def _scored(facts: ProtocolFacts) -> str:
    if facts.scored_by is None:
        return ""
    return (
        f"\n\nScored again by commit {facts.scored_by}, with a scorer that came later than the "
        "analyses: these are as they were frozen, and their recordings were made again, to the "
        "same bytes."
    )


def _noises() -> str:
    """Return the ranges of noise by system."""
    return ", ".join(
        f"`{proved.name}` {100 * low:g} to {100 * high:g} %"
        for proved in SYSTEMS.values()
        for low, high in [proved.noise]
    )


def _effects() -> str:
    """Return the ranges of effects by system."""
    ranges = [
        f"{low:g} to {high:g} (`{proved.name}`)"
        for proved in SYSTEMS.values()
        if proved.share is None
        for low, high in [proved.effect]
    ]
    return " or ".join(ranges)
