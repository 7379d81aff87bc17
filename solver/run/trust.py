"""Whether a route may be relied on: the checks of a fit, and the one sentence that follows from all of them."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

from solver.run.strict_json import strict

#: Multiple of the expected misfit beyond which no route was found.
POOR = 3.0
#: What to do where the model leaves what noise does not.
DIAGNOSE = "`roadfiber diagnose RUN` says what the model lacks"

#: Name of the check that a diagnosis is; it is told whatever else failed.
DIAGNOSIS = "diagnosis"

Verdict = Literal["passed", "failed", "open"]


@dataclass(frozen=True)
class Gate:
    """One check of a fit.

    Parameters
    ----------
    name : what is checked
    verdict : passed, failed, or open where it could not be checked
    words : what was found, as a clause
    mend : what to do where it failed, step by step
    found, expected, scatter : the number, what is expected, and by how much chance scatters it; NaN where there is none
    taken_up : share of what is wrong that the fit takes up before it shows here; NaN where it is not known
    where : the part of the fiber that a check that failed is about, as "at channels 7 to 12"; "" where it is all of it
    """

    name: str
    verdict: Verdict
    words: str
    mend: tuple[str, ...] = ()
    found: float = float("nan")
    expected: float = float("nan")
    scatter: float = float("nan")
    taken_up: float = float("nan")
    where: str = ""

    @property
    def failed(self) -> bool:
        """Whether it failed."""
        return self.verdict == "failed"


@dataclass(frozen=True)
class Trust:
    """What all checks say together.

    Parameters
    ----------
    sentence : which checks failed and what to do next, or that none did
    grade : good; fair where something could not be checked, or failed along a part of the fiber; weak where a check
        of all of it failed; poor where no route was found
    gates : the checks
    """

    sentence: str
    grade: str
    gates: tuple[Gate, ...]

    @classmethod
    def of(cls, gates: Sequence[Gate]) -> "Trust":
        """From the checks."""
        failed = [one for one in gates if one.failed]
        doubtful = [one for one in gates if one.verdict == "open"]
        held = "; ".join(one.words for one in gates if one.verdict == "passed")
        if failed:
            mended = [one for one in gates if one.failed or one.name == DIAGNOSIS]
            steps = list(dict.fromkeys(step for one in mended for step in one.mend))
            if any(one.name == DIAGNOSIS for one in gates):
                steps = [step for step in steps if step != DIAGNOSE] or ["the diagnosis says what the model may lack"]
            next_steps = "; ".join(steps)
            found = "; ".join(one.words for one in failed)
            local = all(one.where for one in failed)
            where = " and ".join(one.where for one in failed) if local else "as it stands"
            sentence = f"Do not rely on this route {where}: {found}. Next: {next_steps}."
            if local and held:
                sentence += f" Elsewhere no check failed: {held}."
            elif not local:
                told = (one.words for one in gates if one.name == DIAGNOSIS and not one.failed)
                sentence += "".join(f" {words[:1].upper()}{words[1:]}." for words in told)
        else:
            sentence = f"No check failed: {held}."
            if doubtful:
                sentence += f" Not checked: {'; '.join(one.words for one in doubtful)}."
        return cls(sentence, grade_of(gates), tuple(gates))

    @classmethod
    def stored(cls, facts: Mapping[str, Any]) -> "Trust":
        """As fit.json has it."""

        def gate(one: Mapping[str, Any]) -> Gate:
            known: dict[str, Any] = {name: float("nan") if value is None else value for name, value in one.items()}
            return Gate(**known | {"mend": tuple(one["mend"])})

        return cls.of([gate(one) for one in facts["gates"]])


def with_gate(facts: Mapping[str, Any], gate: Gate) -> dict[str, Any]:
    """The trust of a run, as fit.json has it, with one check made, or made again."""
    gates = [one for one in Trust.stored(facts).gates if one.name != gate.name]
    return strict(asdict(Trust.of([*gates, gate])))


def grade_of(gates: Sequence[Gate]) -> str:
    """Grade of a fit with these checks."""
    failed = [one for one in gates if one.failed]
    if any(
        one.name == "converged" or (one.name == "misfit" and not one.found <= POOR * one.expected) for one in failed
    ):
        return "poor"
    if any(not one.where for one in failed):
        return "weak"
    return "fair" if failed or any(one.verdict == "open" for one in gates) else "good"
