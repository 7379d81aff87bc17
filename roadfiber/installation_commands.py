"""`roadfiber doctor` and `schema`."""

import json
from typing import Annotated

import typer

app = typer.Typer()


@app.command()
def doctor(as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of words.")] = False) -> None:
    """Say what of roadfiber works on this machine, and what is missing for what.

    Versions, packages, ONNX providers, fonts, browser, whether the cache can be written, optional extras. Exit status 2
    where something is broken that roadfiber needs.

    Example: `roadfiber doctor`
    """
    import roadfiber as rf

    found = rf.doctor()
    print(json.dumps(found.facts, indent=1) if as_json else "\n".join(found.lines()))
    if not found.healthy:
        raise typer.Exit(2)


@app.command()
def schema(
    file: Annotated[str | None, typer.Argument(help="As fit.json.", show_default="lists the files")] = None,
) -> None:
    """Print the JSON Schema of a file that roadfiber reads or writes; of a csv file, that of a row.

    Example: `roadfiber schema fit.json > fit.schema.json`
    """
    import roadfiber as rf

    if file is None:
        from roadfiber.schemas import FILES

        print("\n".join(FILES))
        return
    print(json.dumps(rf.schema(file), indent=1))
