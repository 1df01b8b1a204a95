"""Publish cases without their truths: ``python -m dashred.evaluation.publish draw=SECRET output=conf/proof``.

``truths=FILE`` takes what was hidden, with a salt; the repository gets its hashes alone.
``check=FILE`` says which claimed truths, in the form of that file, are the right ones.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dashred.core.errors import DONE, InputError, run_entry

KEYS = ("draw", "cases", "output", "truths", "check")


def main(argv: list[str]) -> int:
    """Publish, or check what was claimed."""
    words = dict(word.partition("=")[::2] for word in argv)
    publishing = {"draw", "output", "truths"} <= words.keys()
    if not words.keys() <= set(KEYS) or not (publishing or {"output", "check"} <= words.keys()):
        raise InputError(
            "draw=SECRET, output=DIR and truths=FILE are needed, or output=DIR and check=FILE",
            where="command line",
            hint=f"known words: {', '.join(KEYS)}",
        )
    cases = words.get("cases", "8")
    if not cases.isdecimal():
        raise InputError(f"cases must be a whole number, not {cases!r}", where="command line")

    from dashred.evaluation.proof.cases.public import check, choose, publish

    folder = Path(words["output"])
    if "check" in words:
        for name, right in check(folder, Path(words["check"])).items():
            print(f"{name}: {'the truth' if right else 'not the truth'}")
        return DONE
    publish(choose(words["draw"], int(cases)), folder, Path(words["truths"]))
    return DONE


if __name__ == "__main__":
    sys.exit(run_entry(main))
