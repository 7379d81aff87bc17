"""What every located fiber says first, be it of a street or of a drive."""

from typing import Any


class LocatedFiber:
    """Name, headline and trust, from the content of fit.json.

    >>> fiber = LocatedFiber()
    >>> fiber.facts = {"name": "main-street", "trust": {"sentence": "No check failed."}}
    >>> fiber.name, fiber.trust
    ('main-street', 'No check failed.')
    """

    facts: dict[str, Any]

    @property
    def name(self) -> str:
        """Of the survey."""
        return str(self.facts["name"])

    @property
    def headline(self) -> str:
        """Where the fiber is, in a sentence."""
        return str(self.facts["headline"])

    @property
    def trust(self) -> str:
        """Whether the route may be relied on, in a sentence that follows from all checks."""
        return str(self.facts["trust"]["sentence"])
