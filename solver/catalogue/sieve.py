"""Where discrepancy models come from: each is a sum of smooth functions that could take any form."""

SOURCE = "Generic; sieve of smooth functions (Chen 2007, Handbook of Econometrics 6B, chapter 76)."
