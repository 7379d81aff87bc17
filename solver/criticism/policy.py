"""Every number that a decision of criticism hangs on, each with where it comes from."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Policy:
    """Prior odds, tolerances and limits.

    "Measured" is on the training surveys of `benchmarks/blind.py`, whose seeds no reported figure has seen.

    Parameters
    ----------
    nothing, known, two, fault, unknown : prior probabilities: that nothing is missing; one effect of the catalogue, any
        of them alike; two of them; a fault of the survey; something that no catalogue has, at any stage alike. What
        `benchmarks/blind.py` draws, about; e-fold odds move an evidence of hundreds by 1
    overlooked : prior probability of something that shows, and that neither the catalogue nor the models of what is
        unknown imitate. Measured: of 170 surveys where nothing held most, on 14 something was missing
    inexact : share of the signal by which the base model may be off in any one direction: chi2 is divided by one plus
        its square times the signal's chi2. Measured
    tolerance : the same of what the fit leaves of an effect, by which its law may be off. CRITICISM.md; measured
    held : probability that the smallest set of explanations holds
    found : ln of the Bayes factor from which on an effect shows, and a discrepancy model is fitted in full
    leveled : ln of the Bayes factor for something unknown in the processing, of noise weaker where vehicles are loud
    bare : ln of a Bayes factor that is not worth more than a bare mention; known effects of many numbers are fitted in
        full unless their scores speak against them by more. Kass and Raftery 1995, J. Am. Stat. Assoc. 90, 773
    negligible : share of its plausible size below which an effect is negligible even if present
    mixed : correlation of the noise of neighboring channels above which noise was mixed after it was read
    extreme : root mean square of numbers, in plausible sizes, beyond which an effect is not what it is said to be
    racers, unknown_racers : how many are fitted in full, and how many discrepancy models among them
    besides : of how many known effects what they leave is looked at
    far : ln of the odds from which on a known effect is not looked beside of
    stay : share of the leader's evidence that one must have, or may hope for, to be fitted to its end
    hope : times the fall that the next step predicts which a fit may still hope for
    shifted : shifts of the tracks, in what was expected, that a delay may be behind
    late : share of the best one's evidence that an effect must have to start with unshifted tracks
    fixed : how much more of chi2 must fall with the same profile along the fiber than with the same along travel
    converged : sigmas left along fitted directions at which a fit counts as converged
    """

    nothing: float = 0.45
    known: float = 0.3
    two: float = 0.05
    fault: float = 0.05
    unknown: float = 0.12
    overlooked: float = 0.03
    inexact: float = 0.003
    tolerance: float = 0.05
    held: float = 0.95
    found: float = 6.0
    leveled: float = 60.0
    bare: float = 1.0
    negligible: float = 0.1
    mixed: float = 0.1
    extreme: float = 3.0
    racers: int = 11
    unknown_racers: int = 3
    besides: int = 3
    far: float = 10.0
    stay: float = 0.75
    hope: float = 2.0
    shifted: float = 1.0
    late: float = 0.25
    fixed: float = 1.2
    converged: float = 0.5


POLICY = Policy()
