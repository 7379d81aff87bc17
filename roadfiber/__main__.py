"""`python -m roadfiber`."""

from roadfiber.command import main

main()
